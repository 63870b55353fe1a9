"""``explicitfe design-test``: what a planned protocol can find and tell apart, before anything is measured.

The same fingerprints as in the loop, about what an elastic model would answer.
"""

from __future__ import annotations

import tempfile
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, ValidationError

from explicitfe.close_loop.search import covariance_of
from explicitfe.close_loop.specimens.simulator import Simulator
from explicitfe.close_loop.specimens.specimens import COARSE, Specimens
from explicitfe.close_loop.statistics.covariance import Covariance, stacked
from explicitfe.close_loop.statistics.fingerprints import DISTINCT, Fingerprint, fingerprints
from explicitfe.close_loop.statistics.noise import RowNoise, Scatter
from explicitfe.close_loop.statistics.refit import Fitted, derivatives
from explicitfe.errors import InputError, Progress, RunError, silent
from explicitfe.measured.curve import COLUMNS, TIME, Dataset
from explicitfe.measured.read import read_dataset
from explicitfe.predict.tissue import toml_value
from explicitfe.scenario.sentences import explain
from explicitfe.scenario.table import Table, validated

FORMAT = "explicitfe-protocol/1"


class ConstantsTable(Table):
    """What the tissue is expected to be."""

    C10_Pa: float = Field(gt=0.0)
    C20_Pa: float = Field(default=0.0, ge=0.0)


class PlannedCurve(Table):
    """One curve that would be measured."""

    id: str = Field(min_length=1)
    programme: list[tuple[float, float]] = Field(min_length=2, description="time [s] and what is imposed then, in its unit")
    rows: int | None = Field(default=None, ge=3, description="evenly spaced rows; one a point of the programme if left out")
    constants: str = "all"
    group: str | None = None
    specimen: dict[str, Any] = Field(default={})
    tool: dict[str, Any] = Field(default={})
    conditions: dict[str, Any] = Field(default={})


class ProtocolFile(Table):
    """The schema of a protocol; [specimen], [tool] and [noise] are those of a dataset."""

    format: Literal["explicitfe-protocol/1"]
    title: str
    test: Literal["indentation", "compression", "tension", "shear"]
    constants: ConstantsTable
    specimen: dict[str, Any]
    tool: dict[str, Any] | None = None
    noise: dict[str, Any]
    curve: list[PlannedCurve] = Field(min_length=1)


def design_test(path: Path | str, *, processes: int | None = None, progress: Progress = silent) -> dict[str, Any]:
    """Which effects a planned test could find, and which it could not tell apart.

    Parameters
    ----------
    path : a protocol file; its format is in docs/close-loop.md.

    Returns
    -------
    For each effect: whether its largest plausible strength would show, the smallest strength that would, what constants it
    would hide in if nobody looked for it, and the effect that it would be mistaken for most easily.

    Raises
    ------
    InputError : a protocol that cannot be used. RunError : the simulator cannot follow it.
    """
    path = Path(path)
    protocol = _read(path)
    progress("design", 0.0)
    simulator = Simulator(processes)
    try:
        system = _system(path, protocol, simulator)
        progress("design", 0.1)
        fit, covariance = _elastic(system, protocol)
        candidates = system.candidates(fit.model)
        simulator.watch = lambda: progress("design", 0.1 + 0.9 * (1.0 - np.exp(-simulator.runs / (30.0 * len(system.tests)))))
        prints = fingerprints(system, fit, covariance, candidates)
        progress("design", 1.0)
    finally:
        simulator.close()
    rows = []
    for candidate in candidates:
        mine = next((p for p in prints if p.candidate is candidate), None)
        row: dict[str, Any] = {"effect": candidate.effect, "strength": candidate.term.parameters[0].name}
        if mine is None or not mine.values:
            rows.append(row | {"shows": False, "reason": candidate.reason or "the model cannot be computed with it"})
            continue
        rows.append(row | _shows(mine, fit, system, covariance) | _nearest(mine, prints))
    return {
        "protocol": protocol.title,
        "file": str(path),
        "n_eff": covariance.effective,
        "constants": protocol.constants.model_dump(),
        "effects": sorted(rows, key=lambda r: -r.get("visible", 0.0)),
        "runs": simulator.runs,
    }


def _shows(mine: Fingerprint, fit: Fitted, system: Specimens, covariance: Covariance) -> dict[str, Any]:
    """How strong an effect has to be, and what it hides in meanwhile."""
    size = (mine.secants**2).sum(axis=0)
    best = int(np.argmax(size * mine.plausible**2))
    strength = mine.candidate.term.parameters[0].sought
    none = strength.coordinate(strength.none)
    way = strength.coordinate(mine.values[best][0]) - none
    needed = float(np.sqrt(DISTINCT / max(size[best], 1e-300)))
    plausible = strength.value(none + float(mine.plausible[best]) * way)
    shows = mine.visible >= DISTINCT
    (answer,) = system.answers([fit.model.plus(mine.candidate.term, mine.values[best])])
    hides = {}
    if answer is not None:
        moved = np.linalg.lstsq(fit.jacobian, covariance.whiten(stacked(answer) - fit.answer), rcond=None)[0]
        moved *= min(needed, float(mine.plausible[best]))
        for p, x, dx in zip(fit.model.parameters, fit.model.x, moved, strict=True):
            hides[p.name] = p.sought.value(float(np.clip(x + dx, p.low, p.high))) / p.sought.value(float(x)) - 1.0
    return {
        "shows": shows,
        "visible": mine.visible,
        "largest_plausible": plausible,
        "smallest": strength.value(none + needed * way) if needed <= mine.limits[best] else None,
        "hides_in": hides,
        "reason": "" if shows else f"its largest plausible strength stays under the floors ({mine.visible:.2g} of {DISTINCT:g})",
    }


def _nearest(mine: Fingerprint, prints: list[Fingerprint]) -> dict[str, Any]:
    """The effect that imitates this one best, at its largest plausible strength, and how far off it stays."""
    best = int(np.argmax((mine.secants**2).sum(axis=0) * mine.plausible**2))
    target = mine.secants[:, best] * mine.plausible[best]
    apart: dict[str, float] = {}
    for other in prints:
        if other is mine or not other.values:
            continue
        along, size = other.secants.T @ target, (other.secants**2).sum(axis=0)
        amplitude = np.clip(along / np.maximum(size, 1e-300), 0.0, other.limits)
        rest = float(target @ target) - 2.0 * amplitude * along + amplitude**2 * size
        apart[other.candidate.effect] = float(rest.min())
    if not apart:
        return {"nearest": None, "separation": None, "cannot_tell_from": []}
    nearest = min(apart, key=apart.__getitem__)
    return {
        "nearest": nearest,
        "separation": apart[nearest],
        "cannot_tell_from": [name for name, gap in sorted(apart.items(), key=lambda entry: entry[1]) if gap < DISTINCT],
    }


def _elastic(system: Specimens, protocol: ProtocolFile) -> tuple[Fitted, Covariance]:
    """The elastic model at the expected constants, with the covariance of what is planned."""
    start = system.start()
    values = [getattr(protocol.constants, p.name) for p in start.parameters]
    model = start.at(np.array([p.sought.coordinate(v) for p, v in zip(start.parameters, values, strict=True)]))
    (answer,) = system.answers([model])
    assert answer is not None
    rows = [
        RowNoise(np.maximum(np.hypot(one.noise_sd or 0.0, one.imposed_sd), 1e-6 * np.abs(one.measured).max()), 0.0, True)
        for one in system.series
    ]
    spread = Scatter(max((one.scatter or 0.0 for one in system.series), default=0.0), 0.0, "stated", 0)
    assumed = {name: stacked(found) - stacked(answer) for name, found in system.assumptions(model).items()}
    covariance = covariance_of(system, model, rows, spread, assumed)
    covariance = covariance.at(stacked(answer))
    slopes = derivatives(system, model, stacked(answer))
    fit = Fitted(model, stacked(answer), slopes, np.zeros(len(slopes)), covariance.whiten(slopes), (), True)
    return fit, covariance


def _system(path: Path, protocol: ProtocolFile, simulator: Simulator) -> Specimens:
    """The planned tests with what an elastic tissue would answer."""
    dataset = _dataset(path, protocol)
    planned = Specimens(dataset, dataset.curves, simulator, COARSE)
    start = planned.start()
    constants = protocol.constants.model_dump()
    model = start.at(np.array([p.sought.coordinate(constants[p.name]) for p in start.parameters]))
    (answer,) = planned.answers([model])
    if answer is None:
        raise RunError(f"{path}: the simulator cannot follow the programme with these constants; ask for smaller loads.")
    curves = []
    for curve, values in zip(dataset.curves, answer, strict=True):
        curves.append(replace(curve, columns=curve.columns | {curve.predicted: values}))
    return replace(planned, curves=tuple(curves), dataset=replace(dataset, curves=tuple(curves)))


def _dataset(path: Path, protocol: ProtocolFile) -> Dataset:
    """The protocol as a dataset, so that the same checks apply; the column that is not known yet is a guess of its size."""
    tool = protocol.tool
    kind = "shear" if protocol.test == "shear" else "uniaxial" if tool is None else "force-displacement"
    first, second = COLUMNS[kind]
    by_force = tool is not None and tool.get("control") == "force"
    with tempfile.TemporaryDirectory() as folder:
        lines = [
            'format = "explicitfe-dataset/1"',
            'name = "protocol"',
            f"title = {toml_value(protocol.title)}",
            f"test = {toml_value(protocol.test)}",
        ]
        for name, table in (("specimen", protocol.specimen), ("tool", tool), ("noise", protocol.noise)):
            if table is not None:
                lines += [f"[{name}]", *(f"{key} = {toml_value(value)}" for key, value in table.items())]
        for number, curve in enumerate(protocol.curve):
            lines += ["[[curve]]", f"id = {toml_value(curve.id)}", f'file = "{number}.csv"']
            lines += [f"constants = {toml_value(curve.constants)}"]
            lines += [f"group = {toml_value(curve.group)}"] if curve.group else []
            lines += [
                f"{key} = {toml_value(getattr(curve, key))}" for key in ("specimen", "tool", "conditions") if getattr(curve, key)
            ]
            t, x = np.array(curve.programme).T
            if np.any(np.diff(t) <= 0.0) or t[0] != 0.0:
                raise InputError(f'{path}: the programme of curve "{curve.id}" must begin at 0 s, and time must increase.')
            if np.ptp(x) == 0.0 and x[0] == (1.0 if kind == "uniaxial" else 0.0):
                raise InputError(f'{path}: the programme of curve "{curve.id}" never leaves the state at rest.')
            rows = t if curve.rows is None else np.linspace(0.0, t[-1], curve.rows)
            way = np.interp(rows, t, x)
            guess = _guess(protocol, curve, kind, way, by_force)
            both = (guess, way) if by_force else (way, guess)
            text = [f"{TIME},{first},{second}", *(f"{a:.9g},{b:.9g},{c:.9g}" for a, b, c in zip(rows, *both, strict=True))]
            (Path(folder) / f"{number}.csv").write_text("\n".join(text) + "\n", encoding="utf-8")
        (Path(folder) / "dataset.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
        try:
            return read_dataset(folder)
        except InputError as error:
            raise InputError(f"{path}: as a dataset this would not do: {str(error).replace(folder, '').lstrip('/')}") from None


def _guess(protocol: ProtocolFile, curve: PlannedCurve, kind: str, way: np.ndarray, by_force: bool) -> np.ndarray:
    modulus = 6.0 * protocol.constants.C10_Pa
    if kind == "shear":
        return modulus / 3.0 * way
    if kind == "uniaxial":
        return modulus * (way - 1.0)
    table = (protocol.tool or {}) | curve.tool
    body = protocol.specimen | curve.specimen
    # The tables are not checked yet: that is for whoever reads them as a dataset.
    size = [*body["size_mm"], 20.0, 20.0, 20.0][2] if isinstance(body.get("size_mm"), list) else None
    lengths = [size, body.get("height_mm"), table.get("radius_mm"), body.get("radius_mm")]
    radius = min((x for x in lengths if isinstance(x, int | float) and x > 0.0), default=20.0)
    if by_force:
        return 0.2 * radius * way / max(float(np.abs(way).max()), 1e-300)  # mm
    return modulus * 1e-3 * radius * 1e-3 * way  # N


def _read(path: Path) -> ProtocolFile:
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: the protocol cannot be read ({error.strerror}).") from None
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: this is not valid TOML: {error}.") from None
    if data.get("format") != FORMAT:
        raise InputError(f'{path}: a protocol begins with format = "{FORMAT}".')
    try:
        return validated(ProtocolFile, data)
    except ValidationError as error:
        raise InputError(f"{path}: {explain(error, data, ProtocolFile).replace('the scenario', 'the protocol')}") from None
