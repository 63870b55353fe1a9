"""Derivatives of the measures of a run by keys of its scenario, from one run: the tangents of its state are advanced with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from explicitfe.fem.model.model import Model
from explicitfe.fem.solve.differentiated import Differentiated, check_differentiable
from explicitfe.fem.solve.directions import Direction
from explicitfe.platform.errors import InputError, Progress, RunError, nearest, shortened, silent
from explicitfe.platform.host import stopping
from explicitfe.platform.host.shipped import scenario_file
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.results.files import FINISHED, ResultInMemory
from explicitfe.results.measure.numbers import flat
from explicitfe.results.measure.steps import last_step
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.anatomy.tongue import assemble
from explicitfe.simulate.run.prepare import prepare
from explicitfe.simulate.run.transient import TransientAnalysis
from explicitfe.simulate.scenario.read import read_transient, setting_texts
from explicitfe.simulate.scenario.transient import TransientScenario
from explicitfe.simulate.sweep.rows import PARTS

# Groups of measures that depend on where the body is alone, and the columns of those in which some depend on more.
FROM_POSITIONS: dict[str, tuple[str, ...]] = {
    "points": ("forward_mm", "up_mm", "right_mm", "largest_mm"),
    "highest": (),
    "grooves": ("depth_mm", "behind_tip_mm"),
    "constriction": (),
    "body": ("largest_displacement_mm", "volume_change_percent"),
    "airway": (),
}
USUAL_COLUMNS = ("forward_mm", "up_mm", "right_mm")
MOVED_M = 1e-7  # largest displacement over which a measure is differenced
MATERIAL_KEY = "model.material"


@dataclass(frozen=True)
class Gradient:
    """Measures at the end of a run and their derivatives by keys of its scenario.

    Attributes
    ----------
    by, at : the keys, and their values.
    of, values : names of the measures, and their values (k,), in the units of their names.
    jacobian : (k, keys) derivatives, in the unit of the measure over that of the key.
    time_s : (T,) s. Times of the samples.
    probes : of each named point its displacement (T, 3) m.
    probe_changes : of each named point the derivatives (T, keys, 3) of its displacement, m over the unit of the key.
    warnings : of the run.
    """

    by: tuple[str, ...]
    at: tuple[float, ...]
    of: tuple[str, ...]
    values: np.ndarray
    jacobian: np.ndarray
    time_s: np.ndarray = field(repr=False)
    probes: dict[str, np.ndarray] = field(repr=False)
    probe_changes: dict[str, np.ndarray] = field(repr=False)
    warnings: tuple[str, ...] = ()

    def derivative(self, of: str, by: str) -> float:
        """The derivative of one measure by one key.

        Raises
        ------
        InputError : no such measure or key.
        """
        for name, names in ((of, self.of), (by, self.by)):
            if name not in names:
                raise InputError(f'gradient: there is no "{shortened(name)}"; {nearest(name, names)}')
        return float(self.jacobian[self.of.index(of), self.by.index(by)])

    @property
    def document(self) -> dict[str, object]:
        """The values and derivatives as nested dictionaries of numbers."""
        rows = {
            name: {"value": float(value), "by": dict(zip(self.by, map(float, row), strict=True))}
            for name, value, row in zip(self.of, self.values, self.jacobian, strict=True)
        }
        return {"at": dict(zip(self.by, self.at, strict=True)), "of": rows, "warnings": list(self.warnings)}


def gradient(
    scenario: Path | str,
    by: Sequence[str],
    of: Sequence[str] | None = None,
    *,
    settings: Sequence[str] | dict[str, object] = (),
    progress: Progress = silent,
) -> Gradient:
    """Run a scenario once, with the derivatives of its measures by keys such as ``muscle.GGp.force_N``.

    The derivatives are those of the computed motion at the steps that it takes: where it is smooth they agree with differences of
    two runs with the same steps. A measure that is no displacement of a point is differenced along the motion, without a run.

    Parameters
    ----------
    scenario : scenario file, or a name of ``explicitfe list scenarios``.
    by : keys of the scenario with a number, as ``sweep`` varies them; a muscle that is not listed is added with a force of 0.
    of : measures at the end as the columns of a sweep name them, such as "points.tip.up_mm"; the displacements of all named
        points if left out.
    settings : values that replace those of the scenario, as for ``run``.
    progress : called with the stage and the share of it that is done.

    Raises
    ------
    InputError : something in the scenario has no derivative, or no such key or measure; nothing was run.
    RunError : the run could not be finished.
    """
    path = scenario_file(scenario)
    texts = setting_texts(settings)
    if isinstance(by, str) or not by or not all(isinstance(key, str) for key in by) or len(set(by)) < len(by):
        raise InputError("gradient: `by` must be a list of different keys, such as ['muscle.GGp.force_N'].")
    texts, at = _with_numbers(path, texts, by)
    scenario_read = read_transient(path, texts)
    columns = _columns(of)
    if scenario_read.release is not None:
        raise InputError("gradient: [release] has no derivative here; leave it out, or take differences of two runs.")

    def model_at(key: str, value: float) -> Model:
        return assemble(read_transient(path, [*texts, f"{key}={value!r}"]), path.parent).model

    directions = [Direction(key, value, partial(model_at, key)) for key, value in zip(by, at, strict=True)]
    analysis = prepare(path, texts)
    assert isinstance(analysis, TransientAnalysis)
    check_differentiable(analysis.model)
    body = Differentiated(analysis.model, directions)
    result = ResultInMemory(path)
    with stopping.watching():
        summary = replace(analysis, body=body).run(result, overwrite=False, progress=progress)
    if summary["status"] != FINISHED:
        raise RunError(f"{path}: {summary['message']}")
    names, values, jacobian = _jacobian_of(result, body, columns)
    history = np.array(body.probe_history)
    return Gradient(
        by=tuple(by),
        at=tuple(at),
        of=names,
        values=values,
        jacobian=jacobian,
        time_s=result.history("time"),
        probes={name: result.history(f"probe_{name}_displacement") for name in body.model.probes},
        probe_changes={name: history[:, :, k] for k, name in enumerate(body.model.probes)},
        warnings=tuple(summary["warnings"]),
    )


def _with_numbers(path: Path, texts: list[str], by: Sequence[str]) -> tuple[list[str], list[float]]:
    """The settings that make every key a number of the scenario, and these numbers."""
    scenario = read_transient(path, texts)
    material = scenario.model.material
    if isinstance(material, str) and any(key.startswith(f"{MATERIAL_KEY}.") for key in by):
        constants = catalogue.material(material).model_dump(exclude={"source"})
        texts = [*texts, f"{MATERIAL_KEY}={toml_value(constants)}"]
    listed = {muscle.name for muscle in scenario.muscle}
    for key in by:
        first, _, tail = key.partition(".")
        name, _, last = tail.partition(".")
        if first == "muscle" and not name.isdecimal() and name not in listed and last == "force_N":
            texts = [*texts, f"{key}=0.0"]
    scenario = read_transient(path, texts)
    return texts, [_number_at(scenario, key) for key in by]


def _number_at(scenario: TransientScenario, key: str) -> float:
    """The number that a key has in a scenario.

    Raises
    ------
    InputError : it has none.
    """
    at: object = scenario
    for part in key.split("."):
        if isinstance(at, list | tuple):
            named = [one for one in at if getattr(one, "name", None) == part]
            at = named[0] if len(named) == 1 else (at[int(part) - 1] if part.isdecimal() and 1 <= int(part) <= len(at) else None)
        elif isinstance(at, dict):
            at = at.get(part)
        else:
            at = getattr(at, part, None) if part in getattr(type(at), "model_fields", {}) else None
    if isinstance(at, bool) or not isinstance(at, int | float):
        raise InputError(f'gradient: "{shortened(key)}" has no number in the scenario; name a key such as muscle.GGp.force_N.')
    return float(at)


def _columns(of: Sequence[str] | None) -> tuple[str, ...] | None:
    """The measures that are wanted; refused where they depend on more than positions."""
    if of is None:
        return None
    if isinstance(of, str) or not all(isinstance(name, str) for name in of):
        raise InputError("gradient: `of` must be a list of measures, such as ['points.tip.up_mm'].")
    for name in of:
        part, _, tail = name.partition(".")
        if part not in FROM_POSITIONS:
            raise InputError(
                f'gradient: the measure "{shortened(name)}" has no derivative here; choose one of {", ".join(FROM_POSITIONS)}.'
            )
        known = FROM_POSITIONS[part]
        if known and tail.rpartition(".")[2] not in known:
            raise InputError(
                f'gradient: the measure "{shortened(name)}" has no derivative here; of {part} there are {", ".join(known)}.'
            )
    return tuple(of)


def _jacobian_of(
    result: ResultInMemory, body: Differentiated, columns: tuple[str, ...] | None
) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Names, values and derivatives of measures at the end."""
    parts = ("points",) if columns is None else tuple(dict.fromkeys(name.partition(".")[0] for name in columns))
    step = last_step(result)
    cells = _cells(result, parts, step)
    if columns is None:
        columns = tuple(name for name in cells if name.rpartition(".")[2] in USUAL_COLUMNS)
    for name in columns:
        if not isinstance(cells.get(name), float):
            raise InputError(f'gradient: the run has no measure "{shortened(name)}"; {nearest(name, cells)}')
    jacobian = np.empty((len(columns), len(body.directions)))
    history = np.array(body.probe_history)
    for k, change in enumerate(body.displacement_changes):
        size = MOVED_M / max(np.abs(change).max(), 1e-300)
        moved = []
        for sign in (size, -size):
            paths = {f"probe_{name}_displacement": sign * history[:, k, p] for p, name in enumerate(body.model.probes)}
            moved.append(_cells(result.copy_with(sign * change, paths), parts, step))
        jacobian[:, k] = [(moved[0][name] - moved[1][name]) / (2.0 * size) for name in columns]
    _use_exact_points(jacobian, columns, body)
    return columns, np.array([cells[name] for name in columns], dtype=float), jacobian


def _use_exact_points(jacobian: np.ndarray, columns: Sequence[str], body: Differentiated) -> None:
    """Displacements of named points are linear in those of nodes: no difference is needed."""
    last = np.array(body.probe_history[-1])
    names = list(body.model.probes)
    axis = {"forward_mm": (0, -1e3), "right_mm": (1, 1e3), "up_mm": (2, 1e3)}
    for row, column in enumerate(columns):
        part, _, tail = column.partition(".")
        name, _, kind = tail.rpartition(".")
        if part == "points" and name in names and kind in axis:
            component, factor = axis[kind]
            jacobian[row] = factor * last[:, names.index(name), component]


def _cells(result: ResultInMemory, parts: Sequence[str], step: int) -> dict[str, float]:
    cells: dict[str, float] = {}
    for part in parts:
        row = flat(PARTS[part](result, step), part)
        cells |= {name: float(value) for name, value in row.items() if isinstance(value, int | float)}
    return cells
