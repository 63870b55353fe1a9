"""What a finer mesh would answer: a run on the usual mesh corrected by a factor of the depth, read off a few elastic ramps.

The relative error of a mesh depends on the depth of the tool, hardly on time and little on the constants. The ratio of what the
tissue answers to one ramp on a fine mesh and on the usual one therefore corrects any load history of the same test. The ramps
are computed for the tissue with its elastic effects. The same ratio corrects what the usual run leaves out: a block that is
computed as a cylinder of the same face, or a tool that leans, which needs hexahedra.

An edge that is stated as sharp is computed with two radii of rounding and extrapolated to none, since the force is linear in a
small radius. A body without rotational symmetry is computed on two meshes of hexahedra and extrapolated (Richardson 1911).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from explicitfe.fem.effects import Measurement, physics_of, readings_of
from explicitfe.fem.effects.effect import with_leaves
from explicitfe.inverse.measured.curve import Curve, programme_of
from explicitfe.inverse.predict.experiment import experiments
from explicitfe.inverse.predict.reading import true_programme, without_compliance
from explicitfe.inverse.predict.setup import RADIUS_OVER_SHARP_EDGE
from explicitfe.inverse.predict.tissue import Numerics, Tissue
from explicitfe.inverse.predict.under_a_tool import is_homogeneous

# Rows of a ramp, closer to each other at first touch by this power of their number: under a ball the depth is a broken power of
# the force. A cubic between them is right to 1 micrometre at 5 mm (root mean square), for a flat tool and a ball.
RAMP_ROWS, RAMP_POWER = 33, 1.5
# Density of the instants of a ramp of hexahedra, whose ripple more of them follow, and of a section; the tolerance of ramps of
# hexahedra: with 2e-4 the depth changes by 1 micrometre.
RAMP_DENSITY, SMOOTH_DENSITY, FINE_TOLERANCE = 2.0, 1.0, 5e-4
# The largest load of a ramp is rounded up to a power of this ratio, so that small changes of a reading share one cached ramp.
RAMP_STEP_RATIO = 1.05
# A section is computed on two meshes that differ by this ratio. The error of the finer one is this share of the difference: under
# a flat tool it falls with the power 1.7 or faster, so that the rest is less than the difference.
MESH_RATIO, ERROR_SHARE_OF_SECTION = 1.5, 0.5
# Power of the element size with which the error of hexahedra falls, and its standard deviation. Refinements of 0.6, 1.0 and 1.5
# under a flat tool are off by 32.6, 13.5 and 6.7 micrometres: 1.73 and 1.74. Contact lowers the 2 of a smooth solution.
MESH_ORDER, MESH_ORDER_SD = 1.75, 0.2
# Refinement of the finer mesh of hexahedra.
FINEST_IN_SPACE = 1.0
# Degree, in the load, of the smooth ratios of answers, and of the answer to a ramp of hexahedra without its ripple.
RATIO_DEGREE, SMOOTH_DEGREE = 3, 5
# The step from a rounded edge to a sharp one is linear in the radius to a tenth. But an edge that is called sharp is broken by
# some tenth of a millimetre where it was machined: of a tool of 12 mm that is 0.3 of the step from its 28th part, one standard
# deviation.
ERROR_SHARE_OF_EDGE = 0.3

Job = tuple[tuple[Curve, ...], Tissue]
Run = list[np.ndarray] | str  # what each curve of the test answers in SI, or why it cannot be computed


@dataclass(frozen=True, eq=False)
class Correction:
    """The factor of a usual answer as a function of the depth, with its errors.

    Attributes
    ----------
    depth_m : (m,) depths of the tool in the usual run, increasing.
    factor : (m,) fine answer over usual answer.
    errors : name -> (m,) one standard deviation of the factor's relative error; the errors are independent of each other.
    """

    depth_m: np.ndarray
    factor: np.ndarray
    errors: Mapping[str, np.ndarray]

    def applied(self, answer: np.ndarray, programme: np.ndarray, by_force: bool, compliance_m_N: float = 0.0) -> np.ndarray:
        """A usual answer (k,) to a true programme (k,), corrected.

        Parameters
        ----------
        compliance_m_N : of the rig, whose part of the displacement needs no correction.
        """
        rig = compliance_m_N * (programme if by_force else answer)
        tissue, moved = (answer - rig, programme) if by_force else (answer, programme - rig)
        return tissue * self._at(self.factor, tissue, moved, by_force) + (rig if by_force else 0.0)

    def error_of(self, name: str, answer: np.ndarray, programme: np.ndarray, by_force: bool) -> np.ndarray:
        """One of the errors as a share of the answer (k,)."""
        return self._at(self.errors[name], answer, programme, by_force)

    def _at(self, column: np.ndarray, answer: np.ndarray, programme: np.ndarray, by_force: bool) -> np.ndarray:
        return np.interp(answer if by_force else programme, self.depth_m, column)


def corrections_of(tissue: Tissue, curves: Sequence[Curve], run: Callable[[list[Job]], list[Run]]) -> dict[str, Correction]:
    """Curve -> the correction of its answer; none where no mesh is needed or the ramps cannot be computed.

    Parameters
    ----------
    tissue : with ``numerics.finer`` above 0, else nothing is corrected.
    curves : those that are asked for; tests of one kind share their ramps, down to the largest depth of them.
    run : computes tests.
    """
    physics, readings = physics_of(tissue.effects.chosen), readings_of(tissue.effects.chosen)
    kinds: dict[str, list[Curve]] = {}
    for test in experiments(curves):
        if tissue.numerics.finer > 0.0 and test[0].tool is not None and not is_homogeneous(test[0], physics):
            kinds.setdefault(kind_of(test[0]), []).extend(test)
    ladders = {kind: _ladder(ramp_of(alike[0], alike, readings), tissue) for kind, alike in kinds.items()}
    runs = iter(run([job for ladder in ladders.values() for job in ladder.values()]))
    by_curve: dict[str, Correction] = {}
    for kind, ladder in ladders.items():
        answers = {name: answer[0] for name, answer in ((name, next(runs)) for name in ladder) if not isinstance(answer, str)}
        if len(answers) == len(ladder):
            (ramp,), _ = ladder["usual"]
            correction = _correction(ramp, answers)
            by_curve |= {curve.id: correction for curve in kinds[kind]}
    return by_curve


def ramp_of(first: Curve, alike: Sequence[Curve], readings: Sequence[Measurement], *, rounded: bool = True) -> Curve:
    """One ramp off which all courses of a kind of test can be read, without what a machine misreads.

    Parameters
    ----------
    rounded : its largest load may be larger than that of the tests, see ``RAMP_STEP_RATIO``.
    """
    assert first.tool is not None
    by_force = first.tool.control == "force"
    top = max(float(true_programme(programme_of(c), c, readings, by_force).max()) for c in alike)
    if rounded and top > 0.0:
        top = RAMP_STEP_RATIO ** float(np.ceil(np.log(top) / np.log(RAMP_STEP_RATIO)))
    share = np.linspace(0.0, 1.0, RAMP_ROWS) ** RAMP_POWER
    guess = max(float(np.abs(c.columns[first.predicted]).max()) for c in alike)
    columns = {first.imposed: share * top, first.predicted: share * guess}
    return replace(first, time_s=share, columns={name: columns[name] for name in first.columns})


@lru_cache(maxsize=10_000)
def kind_of(curve: Curve) -> str:
    """Equal for tests that differ in their course only."""
    known = [curve.conditions.get(key) for key in ("preload_N", "direction")]
    return f"{curve.specimen!r} {curve.tool!r} {curve.constants} {known}"


def for_ramps(tissue: Tissue) -> Tissue:
    """The tissue with the instants of a ramp whose answers are corrected."""
    if tissue.numerics.finer == 0.0:
        return tissue
    return _with(tissue, density=SMOOTH_DENSITY if tissue.numerics.section > 0.0 else RAMP_DENSITY)


def _with(tissue: Tissue, **numerics: float) -> Tissue:
    return tissue.model_copy(update={"numerics": tissue.numerics.model_copy(update=numerics)})


def _bare(tissue: Tissue) -> Tissue:
    """The tissue as an elastic ramp shows it on a body of revolution, without readings."""
    dropped = tuple(
        effect for effect in tissue.effects.chosen if effect.acts_on == "reading" or effect.remembers or not effect.in_revolution
    )
    return without_compliance(tissue.model_copy(update={"effects": tissue.effects.without(dropped)}))[0]


def _ladder(ramp: Curve, tissue: Tissue) -> dict[str, Job]:
    """The ramp as usual, on a fine mesh and on one between them; with a sharp edge also with twice the rounding."""
    assert ramp.specimen is not None and ramp.tool is not None
    numerics = tissue.numerics
    # The usual run is computed as that of the whole tissue, which may need hexahedra or a finite bulk modulus.
    usual = _with(_bare(tissue), section=numerics.section if all(e.in_revolution for e in tissue.effects.chosen) else 0.0)
    if any("drain" in effect.leaves() for effect in with_leaves(tissue.effects.chosen)):
        usual = usual.model_copy(update={"incompressible": False})
    bare = _bare(tissue)

    def job(curve: Curve, **changed: float) -> Job:
        changed = {
            "density": SMOOTH_DENSITY if "section" in changed else RAMP_DENSITY,
            "tolerance": FINE_TOLERANCE,
            "finer": 0.0,
        } | changed
        return (curve,), bare.model_copy(update={"numerics": Numerics(**changed)})

    jobs: dict[str, Job] = {"usual": ((ramp,), for_ramps(usual))}
    if ramp.specimen.size_mm is not None:
        between = FINEST_IN_SPACE / MESH_RATIO
        return jobs | {"fine": job(ramp, refinement=FINEST_IN_SPACE), "coarse": job(ramp, refinement=between)}
    # The tissue at a small rounding is stretched so much that Newton's method does not converge on the finest mesh.
    finest = numerics.finer / MESH_RATIO if _is_sharp(ramp) else numerics.finer
    jobs |= {"fine": job(ramp, section=finest), "between": job(ramp, section=finest / MESH_RATIO)}
    if _is_sharp(ramp):
        assert ramp.tool.radius_mm is not None
        rounded = ramp.tool.model_copy(update={"edge_radius_mm": 2.0 * ramp.tool.radius_mm / RADIUS_OVER_SHARP_EDGE})
        jobs["rounder"] = job(replace(ramp, tool=rounded), section=finest)
    return jobs


def _is_sharp(curve: Curve) -> bool:
    assert curve.tool is not None
    return curve.tool.shape == "flat-cylinder" and curve.tool.edge_radius_mm == 0.0


def _correction(ramp: Curve, answers: Mapping[str, np.ndarray]) -> Correction:
    """The correction from the answers (RAMP_ROWS,) to a ladder of ramps, see :func:`_ladder`."""
    by_force = ramp.imposed == "force_N"
    programme = programme_of(ramp)
    pressed = np.all([answer > 0.0 for answer in answers.values()], axis=0) & (programme > 0.0)
    if not pressed.any():
        return Correction(np.zeros(1), np.ones(1), {})
    load = programme[pressed]
    rows = {name: answer[pressed] for name, answer in answers.items()}
    usual, fine = rows["usual"], rows["fine"]
    columns = _columns(load / load[-1], RATIO_DEGREE)
    factor = _projected(columns, fine / usual, fine)
    errors: dict[str, np.ndarray] = {}
    if "coarse" in rows:
        step = _projected(columns, fine / rows["coarse"], fine) - 1.0
        growth = MESH_RATIO**MESH_ORDER
        factor = factor * (1.0 + step / (growth - 1.0))
        errors["the mesh"] = MESH_ORDER_SD * growth * np.log(MESH_RATIO) / (growth - 1.0) ** 2 * step
    if "between" in rows:
        errors["the mesh"] = ERROR_SHARE_OF_SECTION * (_projected(columns, fine / rows["between"], fine) - 1.0)
    if "rounder" in rows:
        rounding = _projected(columns, (fine - rows["rounder"]) / fine, fine)
        factor = factor * (1.0 + rounding)
        errors["the sharp edge"] = ERROR_SHARE_OF_EDGE * rounding
    depth = usual if by_force else load
    order = np.argsort(depth, kind="stable")
    return Correction(depth[order], factor[order], {name: column[order] for name, column in errors.items()})


# ---- smooth functions of the load ----


def smoothed(answer: np.ndarray, programme: np.ndarray) -> np.ndarray:
    """The answer (m,) to a ramp without the ripple of hexahedra: its ratio to the load is a polynomial plus a logarithm.

    The logarithm stands for the onset of contact, where the force is a power of the depth. Rows where nothing is pressed stay as
    they are.
    """
    pressed = (answer > 0.0) & (programme > 0.0)
    if np.count_nonzero(pressed) <= SMOOTH_DEGREE + 2:
        return answer
    y, load = answer[pressed], programme[pressed]
    share = load / load[-1]
    columns = np.column_stack([_columns(share, SMOOTH_DEGREE), np.log(share)])
    smooth = answer.copy()
    smooth[pressed] = load * _projected(columns, y / load, load)
    return smooth


def _columns(share: np.ndarray, degree: int) -> np.ndarray:
    """Polynomials (m, degree + 1) of the share (m,) of the load; no more of them than rows."""
    return np.polynomial.legendre.legvander(2.0 * share - 1.0, min(degree, len(share) - 1))


def _projected(columns: np.ndarray, rows: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """The sum of columns (m, p) that fits rows (m,) best."""
    basis, _ = np.linalg.qr(weight[:, None] * columns)
    return basis @ (basis.T @ (weight * rows)) / weight
