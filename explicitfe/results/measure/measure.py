"""The measures of a result."""

from __future__ import annotations

from pathlib import Path

from explicitfe.fem.mesh.triangles import surface_triangles
from explicitfe.platform.errors import InputError
from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.files import Recorded, open_result
from explicitfe.results.measure.bodies import roof_of, tongue_of
from explicitfe.results.measure.contact import contacts
from explicitfe.results.measure.document import Constriction, Measures
from explicitfe.results.measure.formants import airway_of
from explicitfe.results.measure.leak import leak
from explicitfe.results.measure.motion import body_motion, point_motions
from explicitfe.results.measure.palatogram import palatogram
from explicitfe.results.measure.reactions import reactions
from explicitfe.results.measure.sections import middle
from explicitfe.results.measure.shape import grooves, highest_point
from explicitfe.results.measure.steps import last_step, step_at
from explicitfe.results.measure.tract import PALATE, Nearest, constriction, narrowest, palate_midline


def measure(path: Path, time_s: float | None = None, formants: bool = False) -> Measures:
    """Measure a result of a run in time; see :func:`explicitfe.measure`."""
    with open_result(path) as result:
        if kind_of(result.model) != "transient":
            raise InputError(f"{path} is the result of an indentation, which has no such measures; see `explicitfe inspect`.")
        return measures_of(result, step_at(result, time_s), formants)


def measures_if_any(result: Recorded) -> Measures | None:
    """The measures at the end of a run in time; None for an indentation, and where no sample can be measured."""
    if kind_of(result.model) != "transient":
        return None
    try:
        return measures_of(result, last_step(result))
    except InputError:
        return None


def measures_of(result: Recorded, step: int, formants: bool = False) -> Measures:
    """The measures at one stored step, whose displacements are finite."""
    mesh, u = tongue_of(result, step)
    return Measures(
        result=str(result.path),
        title=str(result.model.get("scenario", {}).get("title", "")),
        status=result.status,
        time_ms=1e3 * float(result.times[step]),
        points=point_motions(result, step),
        highest=highest_point(mesh, u),
        grooves=grooves(mesh, u),
        constriction=constriction_of(result, step),
        reactions=reactions(result, step),
        contact=contacts(result, step),
        palatogram=palatogram(result, step),
        leak=leak(result, step),
        body=body_motion(result, step),
        airway=airway_of(result, step) if formants else None,
    )


def constriction_of(result: Recorded, step: int) -> Constriction | None:
    """The constriction under the bone called "palate", if the run had one."""
    if PALATE not in result.bones:
        return None
    at_rest, now = result.bones[PALATE], result.placed_bones(step)[PALATE]
    return constriction(*tongue_of(result, step), roof_of(result, 0, at_rest), roof_of(result, step, now))


def nearest_of(result: Recorded, step: int) -> Nearest | None:
    """Where tongue and palate are nearest in the midsagittal plane; None without a palate, or where the plane misses one."""
    if PALATE not in result.bones:
        return None
    mesh, displacement = tongue_of(result, step)
    line = palate_midline(roof_of(result, step, result.placed_bones(step)[PALATE]), middle(mesh))
    tongue, _ = surface_triangles(mesh, mesh.points + displacement)
    return None if line is None else narrowest(line, tongue, middle(mesh))
