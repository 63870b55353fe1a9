"""``explicitfe design-test``: which effects a planned protocol can detect and distinguish.

The signatures are those of the search, about the prediction of an elastic model.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, ValidationError

from explicitfe.fem.inputs.sentences import explain
from explicitfe.fem.inputs.table import MOST_ROWS_OF_A_COURSE, MOST_TABLES_OF_A_KIND, Name, Table, Title, validated
from explicitfe.inverse.close_loop.baseline import covariance_of
from explicitfe.inverse.close_loop.compared import needed_decrease
from explicitfe.inverse.close_loop.specimens.simulator import Simulator
from explicitfe.inverse.close_loop.specimens.specimens import Specimens
from explicitfe.inverse.close_loop.specimens.trials import COARSE
from explicitfe.inverse.close_loop.statistics.budget import Budget
from explicitfe.inverse.close_loop.statistics.covariance import Covariance, stack
from explicitfe.inverse.close_loop.statistics.noise import SMALLEST_NOISE_SHARE, RowNoise, Scatter
from explicitfe.inverse.close_loop.statistics.refit import BestFit, derivatives
from explicitfe.inverse.close_loop.statistics.signatures import Signature, signatures
from explicitfe.inverse.close_loop.statistics.system import Hypothesis
from explicitfe.inverse.measured.curve import COLUMNS, TIME, Kind, SpecimenDataset
from explicitfe.inverse.measured.files import LARGEST_CURVE_ROWS
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.inverse.measured.tables import RawTable
from explicitfe.platform.errors import InputError, Progress, RunError, Share, silent
from explicitfe.platform.host.shipped import protocol_file
from explicitfe.platform.host.text import text_of, toml_of
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.results.documents.planned_test import EffectInTest, PlannedTest
from explicitfe.results.documents.units_of_keys import words_and_unit

FORMAT = "explicitfe-protocol/1"
# Share of the progress until the signatures begin, and their runs of each test, by which the progress goes on.
SYSTEM_PROGRESS, RUNS_OF_A_TEST = 0.1, 30.0
# Guesses of what is not measured yet: a size [mm] where no table states one, and under a force the depth as a share of the size.
USUAL_SIZE_MM, GUESSED_DEPTH_SHARE = 20.0, 0.2


class ConstantsTable(Table):
    """What the tissue is expected to be."""

    C10_Pa: float = Field(gt=0.0)
    C20_Pa: float = Field(default=0.0, ge=0.0)


class PlannedCurve(Table):
    """A curve that would be measured."""

    id: Name
    programme: list[tuple[float, float]] = Field(
        min_length=2, max_length=MOST_ROWS_OF_A_COURSE, description="time [s] and what is imposed then, in its unit"
    )
    rows: int | None = Field(
        default=None, ge=3, le=LARGEST_CURVE_ROWS, description="evenly spaced rows; one a point of the programme if left out"
    )
    constants: str = "all"
    group: str | None = None
    specimen: RawTable = Field(default={})
    tool: RawTable = Field(default={})
    conditions: RawTable = Field(default={})


class ProtocolFile(Table):
    """The schema of a protocol; [specimen], [tool] and [noise] are those of a dataset."""

    format: Literal["explicitfe-protocol/1"]
    title: Title
    test: Literal["indentation", "compression", "tension", "shear"]
    constants: ConstantsTable
    specimen: RawTable
    tool: RawTable | None = None
    noise: RawTable
    curve: list[PlannedCurve] = Field(min_length=1, max_length=MOST_TABLES_OF_A_KIND)


def plan_test(path: Path | str, *, processes: int | None = None, progress: Progress = silent) -> PlannedTest:
    """Predict which effects a planned test can detect and distinguish; see :func:`explicitfe.design_test`."""
    path = protocol_file(path)
    protocol = _read(path)
    progress("design", 0.0)
    budget = Budget()
    simulator = Simulator(processes, budget)
    try:
        system = _system(path, protocol, simulator)
        progress("design", SYSTEM_PROGRESS)
        fit, covariance = _elastic(system, protocol)
        candidates = system.candidates(fit.model)
        usual = RUNS_OF_A_TEST * len(system.tests)
        left = 1.0 - SYSTEM_PROGRESS
        budget.watch = lambda words: progress(
            "design", Share(SYSTEM_PROGRESS - left * float(np.expm1(-budget.spent / usual)), words)
        )
        tested = [c for c in candidates if not c.reason]
        known = signatures(fit, covariance, tested, system.changes(fit.model, tested))
        progress("design", 1.0)
    finally:
        simulator.workers.close()
    effects = []
    for candidate in candidates:
        signature = next((p for p in known if p.candidate is candidate), None)
        if signature is None or not signature.values:
            reason = candidate.reason or "the simulation with this effect failed"
            strength = candidate.term.parameters[0].name
            _, unit = words_and_unit(strength)
            effects.append(EffectInTest(effect=candidate.effect, strength=strength, unit=unit, shows=False, reason=reason))
        else:
            effects.append(_effect_in_test(signature, known, fit, system, covariance))
    return PlannedTest(
        protocol=protocol.title,
        file=str(path),
        n_eff=covariance.effective,
        constants=protocol.constants.model_dump(),
        effects=sorted(effects, key=lambda effect: -effect.visible),
        runs=budget.spent,
    )


def _effect_in_test(
    signature: Signature, known: list[Signature], fit: BestFit, system: Specimens, covariance: Covariance
) -> EffectInTest:
    """How strong an effect has to be to show, what it hides in until then, and what it is mistaken for."""
    size = (signature.secants**2).sum(axis=0)
    best = int(np.argmax(size * signature.plausible**2))
    strength = signature.candidate.term.parameters[0].sought
    none = strength.coordinate(strength.none)
    tried = strength.coordinate(signature.values[best][0]) - none
    plausible = float(signature.plausible[best])
    causes = {one.candidate.cause for one in known}
    least = needed_decrease(covariance, len(causes), 1, signature)
    needed = float(np.sqrt(least / max(size[best], 1e-300)))
    shows = signature.visible >= least
    visible = f"{signature.visible:.2g}, {least:.3g} is required"
    apart = _separations(signature, known)
    distinct = {name: gap for name, gap in apart.items() if gap >= least}
    nearest = min(distinct or apart, key=apart.__getitem__, default=None)
    name = signature.candidate.term.parameters[0].name
    return EffectInTest(
        effect=signature.candidate.effect,
        strength=name,
        unit=words_and_unit(name)[1],
        shows=shows,
        visible=signature.visible,
        largest_plausible=strength.value(none + plausible * tried),
        smallest=strength.value(none + needed * tried) if needed <= signature.limits[best] else None,
        hides_in=_hides_in(signature, best, min(needed, plausible), fit, system, covariance),
        reason="" if shows else f"not detectable: the strongest plausible effect changes chi2 by {visible}",
        nearest=nearest,
        separation=None if nearest is None else apart[nearest],
        cannot_tell_from=sorted((other for other in apart if other not in distinct), key=apart.__getitem__),
    )


def _hides_in(
    signature: Signature, trial: int, times: float, fit: BestFit, system: Specimens, covariance: Covariance
) -> dict[str, float]:
    """Constant -> its relative change (over the other one, where it is 0) that best imitates so many times a trial."""
    (answer,) = system.answers([fit.model.plus(signature.candidate.term, signature.values[trial])])
    hides: dict[str, float] = {}
    if answer is not None:
        moved = np.linalg.lstsq(fit.jacobian, covariance.whiten(stack(answer) - fit.answer), rcond=None)[0]
        moved *= times
        values = [p.sought.value(float(x)) for p, x in zip(fit.model.parameters, fit.model.x, strict=True)]
        for p, x, dx, value in zip(fit.model.parameters, fit.model.x, moved, values, strict=True):
            changed = p.sought.value(float(np.clip(x + dx, p.low, p.high)))
            hides[p.name] = (changed - value) / (value or max(values))
    return hides


def _separations(signature: Signature, known: list[Signature]) -> dict[str, float]:
    """Other effect -> how far it stays off this one at its largest plausible strength."""
    best = int(np.argmax((signature.secants**2).sum(axis=0) * signature.plausible**2))
    target = signature.secants[:, best] * signature.plausible[best]
    apart: dict[str, float] = {}
    for other in known:
        if other is signature or not other.values:
            continue
        along, size = other.secants.T @ target, (other.secants**2).sum(axis=0)
        amplitude = np.clip(along / np.maximum(size, 1e-300), 0.0, other.limits)
        distances = float(target @ target) - 2.0 * amplitude * along + amplitude**2 * size
        apart[other.candidate.effect] = float(distances.min())
    return apart


def _elastic(system: Specimens, protocol: ProtocolFile) -> tuple[BestFit, Covariance]:
    """The elastic model at the expected constants, with the covariance of what is planned."""
    model = _model(system, protocol)
    (answer,) = system.answers([model])
    assert answer is not None
    rows = []
    for one in system.series:
        least = SMALLEST_NOISE_SHARE * np.abs(one.measured).max()
        rows.append(RowNoise(np.maximum(np.hypot(one.noise_sd or 0.0, one.imposed_sd), least), 0.0, True))
    spread = Scatter(max((one.scatter or 0.0 for one in system.series), default=0.0), 0.0, "stated", 0)
    assumed = {name: stack(other) - stack(answer) for name, other in system.assumptions(model).items()}
    covariance = covariance_of(system, model, rows, spread, assumed)
    covariance = covariance.at(stack(answer))
    slopes = derivatives(system, model, stack(answer))
    fit = BestFit(model, stack(answer), slopes, np.zeros(len(slopes)), covariance.whiten(slopes), (), True)
    return fit, covariance


def _system(path: Path, protocol: ProtocolFile, simulator: Simulator) -> Specimens:
    """The planned tests with what an elastic tissue would answer."""
    dataset = _dataset(path, protocol)
    planned = Specimens(dataset, dataset.curves, simulator, COARSE)
    curves = []
    for curve, values in planned.answers_or_reasons(_model(planned, protocol), ramps=True):
        if isinstance(values, str):
            raise RunError(f"{path}: {values} Reduce the loads of the protocol, or check its constants.")
        curves.append(replace(curve, columns=curve.columns | {curve.predicted: values}))
    return replace(planned, curves=tuple(curves), dataset=replace(dataset, curves=tuple(curves)))


def _model(system: Specimens, protocol: ProtocolFile) -> Hypothesis:
    start = system.start()
    values = [getattr(protocol.constants, p.name) for p in start.parameters]
    return start.at(np.array([p.sought.coordinate(v) for p, v in zip(start.parameters, values, strict=True)]))


def _dataset(path: Path, protocol: ProtocolFile) -> SpecimenDataset:
    """The protocol as a dataset, so that the same checks apply; the column that is not known yet is guessed."""
    tool = protocol.tool
    kind: Kind = "shear" if protocol.test == "shear" else "uniaxial" if tool is None else "force-displacement"
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
                raise InputError(f'{path}: `programme` of curve "{curve.id}" must begin at 0 s with increasing times.')
            if np.ptp(x) == 0.0 and x[0] == (1.0 if kind == "uniaxial" else 0.0):
                raise InputError(f'{path}: `programme` of curve "{curve.id}" is constant at rest; add a load.')
            rows = t if curve.rows is None else np.linspace(0.0, t[-1], curve.rows)
            imposed = np.interp(rows, t, x)
            guess = _guess(protocol, curve, kind, imposed, by_force)
            both = (guess, imposed) if by_force else (imposed, guess)
            text = [f"{TIME},{first},{second}", *(f"{a:.9g},{b:.9g},{c:.9g}" for a, b, c in zip(rows, *both, strict=True))]
            (Path(folder) / f"{number}.csv").write_text("\n".join(text) + "\n", encoding="utf-8")
        (Path(folder) / "dataset.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
        try:
            return read_dataset(folder).specimens("a protocol plans")
        except InputError as error:
            raise InputError(f"{path}: invalid protocol: {str(error).replace(folder, '').lstrip('/')}") from None


def _guess(protocol: ProtocolFile, curve: PlannedCurve, kind: Kind, imposed: np.ndarray, by_force: bool) -> np.ndarray:
    """About what a planned test will measure, in the unit of the file."""
    modulus = 6.0 * protocol.constants.C10_Pa
    if kind == "shear":
        return modulus / 3.0 * imposed
    if kind == "uniaxial":
        return modulus * (imposed - 1.0)
    table = (protocol.tool or {}) | curve.tool
    body = protocol.specimen | curve.specimen
    # The tables are checked only where they are read as a dataset, so anything may stand in them.
    size = [*body["size_mm"], USUAL_SIZE_MM, USUAL_SIZE_MM, USUAL_SIZE_MM][2] if isinstance(body.get("size_mm"), list) else None
    lengths = [size, body.get("height_mm"), table.get("radius_mm"), body.get("radius_mm")]
    radius = min((x for x in lengths if isinstance(x, int | float) and x > 0.0), default=USUAL_SIZE_MM)
    if by_force:
        return GUESSED_DEPTH_SHARE * radius * imposed / max(float(np.abs(imposed).max()), 1e-300)  # mm
    return modulus * 1e-3 * radius * 1e-3 * imposed  # N


def _read(path: Path) -> ProtocolFile:
    data = toml_of(text_of(path, f'give a protocol, which begins with format = "{FORMAT}"'), path)
    if data.get("format") != FORMAT:
        raise InputError(f'{path}: a protocol begins with format = "{FORMAT}".')
    try:
        return validated(ProtocolFile, data)
    except ValidationError as error:
        raise InputError(f"{path}: {explain(error, data, ProtocolFile).replace('the scenario', 'the protocol')}") from None
