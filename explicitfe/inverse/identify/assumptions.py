"""Sensitivity of fitted constants to the assumptions on the test, one alternative assumption at a time.

Each alternative is simulated with the fitted constants. A change of the constants compensates a part of the change dy of the
prediction, d theta = -(J^T W J)^-1 J^T W dy to first order; only the residual dy + J d theta would show the alternative. If
d theta is large, the step is made and the alternative is simulated again from there, with J corrected by Broyden's method.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.optimize import lsq_linear

from explicitfe.inverse.identify.fit import Fit, Problem
from explicitfe.inverse.identify.forward import depths, forces, smoothest
from explicitfe.inverse.identify.observed import Observed
from explicitfe.inverse.measured.curve import Curve
from explicitfe.inverse.predict.setup import Setup, SpecimenKeys, ToolKeys
from explicitfe.platform.errors import InputError, RunError

GRAVITY_M_S2 = (0.0, 0.0, -9.81)
# A surface layer such as the tongue's mucosa: its thickness, and its stiffness over the body's.
LAYER_THICKNESS_MM = 1.0
LAYER_STIFFNESS_RATIO = 3.0
OTHER_POISSON_RATIO = 0.49
OTHER_LENGTH_SHARE = 0.2  # A length that the source does not state is taken to be this much shorter, and longer.
DEPTHS_OF_AN_ALTERNATIVE = 12
# Under imposed forces an alternative may sink in deeper than what was measured: the runs go so much farther.
ALTERNATIVE_DEPTH_FACTOR = 1.1
# The answer to a large change of the constants is not linear: another run is made from there, until the last change was less than
# a share of the constants, or so many runs were made.
MOST_RUNS_OF_AN_ALTERNATIVE = 4
SMALL_CHANGE_SHARE = 0.2
SMALLEST_SCALE_C10_SHARE = 0.1  # C20 may be 0: a change of it is compared with no less than this share of C10.
LEAST_C10_SHARE = 0.3  # From one run to the next C10 falls to no less than this share.
LEAST_CHANGE_SHARE = 0.01  # Smaller changes of C10 are not named.
PLATEN_DEPTH_HEIGHT_SHARE = 0.5  # Deeper than this, free sides fold.
# The mesh that goes with a sharper edge is this much coarser: it would take longer than all other alternatives.
SHARP_EDGE_REFINEMENT_FACTOR = 0.75
OTHER_LENGTH_FACTORS = (1.0 - OTHER_LENGTH_SHARE, 1.0 + OTHER_LENGTH_SHARE)
SpecimenLength = Literal["radius_mm", "height_mm", "size_mm", "layer_mm"]
ToolLength = Literal["radius_mm", "edge_radius_mm"]
SPECIMEN_LENGTHS: tuple[SpecimenLength, ...] = ("radius_mm", "height_mm", "size_mm", "layer_mm")
TOOL_LENGTHS: tuple[ToolLength, ...] = ("radius_mm", "edge_radius_mm")


@dataclass(frozen=True)
class Alternative:
    """An alternative to an assumption of the fit: its name in words, the test with it, and whether the dataset leaves it open."""

    name: str
    setup: Setup
    left_open: bool = True


@dataclass(frozen=True)
class Hidden:
    """Effect of an alternative on a fit.

    Attributes
    ----------
    change : (p,) relative changes of the constants; relative to C10 where a constant is 0.
    left : rms residual that the constants cannot compensate, in the unit of the data, SI.
    left_in_noise : the same in standard deviations of the rows.
    problem : why there are no numbers; empty where there are.
    left_open : whether the dataset leaves this open, so that the total interval includes it.
    """

    name: str
    change: np.ndarray | None = None
    left: float = 0.0
    left_in_noise: float = 0.0
    problem: str = ""
    left_open: bool = True


def alternatives(setup: Setup, curve: Curve) -> list[Alternative]:
    """All alternatives that are simulated for a test."""
    specimen, tool = setup.specimen, setup.tool
    assert curve.specimen is not None and curve.tool is not None
    choices = []

    def add(
        name: str,
        of_specimen: SpecimenKeys | None = None,
        of_tool: ToolKeys | None = None,
        poisson: float = setup.poisson,
        left_open: bool = True,
    ) -> None:
        new_specimen: SpecimenKeys = {**specimen, **(of_specimen or {})}
        new_tool: ToolKeys = {**tool, **(of_tool or {})}
        choices.append(Alternative(name, replace(setup, specimen=new_specimen, tool=new_tool, poisson=poisson), left_open))

    if tool["shape"] == "platen" and curve.specimen.base == "unknown":
        add("sticking contact on both faces", {"base": "bonded"}, {"friction": "stick"})
    elif tool["shape"] != "bonded-disc":
        unknown = curve.tool.friction == "unknown" or "friction" in curve.tool.assumed
        if tool["friction"] == "stick":
            add("contact without friction", of_tool={"friction": 0.0}, left_open=unknown)
        else:
            add("sticking contact", of_tool={"friction": "stick"}, left_open=unknown)
        if curve.specimen.base == "unknown":
            add("a sliding base", {"base": "sliding"})
    if "layer_mm" in specimen:
        add("no surface layer", {"layer_mm": 0.0, "layer_stiffness_ratio": 1.0}, left_open="layer_mm" in curve.specimen.assumed)
    else:
        thickness = min(LAYER_THICKNESS_MM, setup.height_mm / 10.0)
        name = f"a surface layer of {thickness:.3g} mm, {LAYER_STIFFNESS_RATIO:g} times as stiff"
        layer: SpecimenKeys = {"layer_mm": thickness, "layer_stiffness_ratio": LAYER_STIFFNESS_RATIO}
        add(name, layer, left_open="layer_mm" not in curve.specimen.model_fields_set)
    add(f"Poisson's ratio {OTHER_POISSON_RATIO:g}", poisson=OTHER_POISSON_RATIO)
    for key in SPECIMEN_LENGTHS:
        if key in curve.specimen.assumed:
            for factor in OTHER_LENGTH_FACTORS:
                add(_length_name("specimen", key, factor), _longer_specimen(specimen, key, factor))
    for tool_key in TOOL_LENGTHS:
        if tool_key in curve.tool.assumed:
            for factor in OTHER_LENGTH_FACTORS:
                add(_length_name("tool", tool_key, factor), of_tool=_longer_tool(tool, tool_key, factor))
    if tool["shape"] == "flat-cylinder":
        half = 0.5 * tool["edge_radius_mm"]
        coarser: SpecimenKeys = {"refinement": SHARP_EDGE_REFINEMENT_FACTOR * specimen["refinement"]}
        stated = "edge_radius_mm" in curve.tool.model_fields_set - set(curve.tool.assumed)
        add(f"the tool's edge rounded by {half:.2g} mm", coarser, {"edge_radius_mm": half}, left_open=not stated)
    add("gravity", {"gravity_m_s2": list(GRAVITY_M_S2)})
    return choices


def _length_name(table: str, key: str, factor: float) -> str:
    return f"{table} {key.removesuffix('_mm').replace('_', ' ')} {100.0 * (factor - 1.0):+.0f} %"


def _longer_specimen(specimen: SpecimenKeys, key: SpecimenLength, factor: float) -> SpecimenKeys:
    if key == "size_mm":
        # The width and breadth of a block were inferred; its thickness is known where it was pressed.
        width, breadth, thickness = specimen["size_mm"]
        return {"size_mm": [factor * width, factor * breadth, thickness]}
    length = specimen[key]
    assert length is not None
    longer: SpecimenKeys = {}
    longer[key] = factor * length
    return longer


def _longer_tool(tool: ToolKeys, key: ToolLength, factor: float) -> ToolKeys:
    longer: ToolKeys = {}
    longer[key] = factor * tool[key]
    return longer


def what_a_fit_hides(
    setup: Setup,
    observed: Sequence[Observed],
    fit: Fit,
    choices: Sequence[Alternative],
    progress: Callable[[], None] = lambda: None,
    others: Problem | None = None,
) -> tuple[list[Hidden], int]:
    """Each alternative, and the number of forward runs.

    Parameters
    ----------
    setup : the test as it was fitted.
    observed, fit : curves of this test, and the constants that were fitted (to these and maybe to others).
    choices : of the same test.
    others : the fitted curves of other tests, whose prediction the alternatives do not change.
    """
    if setup.tool["shape"] == "platen":
        observed, fit = _shallow(observed, fit, PLATEN_DEPTH_HEIGHT_SHARE * 1e-3 * setup.height_mm)
    if not observed:
        return [], 0
    touching = [o.at_contact(o.contact(fit.constants)) for o in observed]
    reach = [o.measured.max() if o.model.by_force else o.imposed.max() for o in touching]
    depth_factor = ALTERNATIVE_DEPTH_FACTOR if observed[0].model.by_force else 1.0
    depths_m = depths(depth_factor * float(max(reach)), DEPTHS_OF_AN_ALTERNATIVE)
    setup = replace(setup, law=fit.law.key)
    lower = np.array(fit.law.lower)
    run = forces(setup, fit.constants, depths_m)
    smooth = smoothest(depths_m, [run])
    runs = 1

    def predicted(force: np.ndarray) -> np.ndarray:
        c, _ = smooth.coefficients(depths_m, force)
        return np.concatenate([(smooth.inverse if o.model.by_force else smooth.at)(c, o.imposed)[0] for o in touching])

    ends = np.cumsum([len(o.measured) for o in observed])

    def without_contact(change: np.ndarray) -> np.ndarray:
        """The part of a change that no other contact compensates."""
        for o, at, row_sd, end in zip(observed, touching, fit.sds, ends, strict=True):
            if o.contact_m is not None:
                slope = o.contact_slope(at.imposed, fit.constants) / row_sd
                part = change[end - len(row_sd) : end]
                part -= slope * (slope @ part) / (slope @ slope)
        return change

    # The test as it was fitted is run at the same depths too, so that the roughness of contact cancels.
    as_fitted = predicted(run)
    sd = np.concatenate(fit.sds)
    start = Problem(observed, fit.sds, fit.law).jacobian(fit.constants)
    beside = np.zeros((0, start.shape[1])) if others is None else others.jacobian(fit.constants)
    start, own = np.concatenate([start, beside]), len(start)
    unit = np.maximum(np.abs(fit.constants), SMALLEST_SCALE_C10_SHARE * fit.constants[0])
    answers = []
    for choice in choices:
        constants = np.array(fit.constants)
        J = start.copy()
        last: tuple[np.ndarray, np.ndarray] | None = None
        try:
            for number in range(MOST_RUNS_OF_AN_ALTERNATIVE):
                force = forces(replace(choice.setup, law=fit.law.key), constants, depths_m)
                change = without_contact((predicted(force) - as_fitted) / sd)
                change = np.concatenate([change, beside @ (constants - fit.constants)])
                runs += 1
                if last is not None:  # Broyden: the last step has shown something of the alternative's own J.
                    along = (constants - last[0]) / unit**2
                    seen = change - last[1] - J @ (constants - last[0])
                    J += np.outer(seen, along) / float(along @ (constants - last[0]))
                last = constants, change
                step = _step(J, change, constants, lower)
                left = change + J @ step
                constants = constants + step
                small = SMALL_CHANGE_SHARE * np.maximum(np.abs(last[0]), SMALLEST_SCALE_C10_SHARE * last[0][0])
                if (np.abs(step) < small).all() or number == MOST_RUNS_OF_AN_ALTERNATIVE - 1:
                    break
                constants[0] = max(constants[0], LEAST_C10_SHARE * last[0][0])
            moved = (constants - fit.constants) / change_unit(fit)
            answers.append(Hidden(choice.name, moved, _rms(left[:own] * sd), _rms(left[:own]), left_open=choice.left_open))
        except (InputError, RunError, ValueError) as error:
            answers.append(Hidden(choice.name, problem=str(error).splitlines()[0], left_open=choice.left_open))
        progress()
    return answers, runs


def change_unit(fit: Fit) -> np.ndarray:
    """What changes (p,) of the constants are relative to."""
    return np.where(fit.constants == 0.0, fit.constants[0], np.abs(fit.constants))


def effect_by_refit(name: str, observed: Sequence[Observed], others: Sequence[Observed], fit: Fit, *, left_open: bool) -> Hidden:
    """Effect of an alternative that needs no simulation: the same rows as ``observed``, with other models."""
    try:
        best = Problem(others, fit.sds, fit.law).solve(fit.constants)
    except RunError as error:
        return Hidden(name, problem=str(error).splitlines()[0], left_open=left_open)
    pairs = zip(observed, others, fit.sds, strict=True)
    change = [(other.predicted(best) - o.predicted(fit.constants), sd) for o, other, sd in pairs if other is not o]
    left, in_noise = (_rms(np.concatenate(parts)) for parts in ([c for c, _ in change], [c / sd for c, sd in change]))
    return Hidden(name, (best - fit.constants) / change_unit(fit), left, in_noise, left_open=left_open)


def _step(J: np.ndarray, change: np.ndarray, constants: np.ndarray, lower: np.ndarray) -> np.ndarray:
    """d theta (p,), so that no constant falls below its lower bound."""
    unit = float(constants[0])
    room = np.minimum((lower - constants) / unit, -1e-12)
    room[0] = -np.inf  # C10 is limited by ``LEAST_C10_SHARE``.
    return unit * lsq_linear(unit * J, -change, bounds=(room, np.full(len(constants), np.inf))).x


def _shallow(observed: Sequence[Observed], fit: Fit, limit_m: float) -> tuple[list[Observed], Fit]:
    """The rows whose depth does not exceed a limit."""
    shallow, sds = [], []
    for o, sd in zip(observed, fit.sds, strict=True):
        kept = (o.measured if o.model.by_force else o.imposed) <= limit_m
        if kept.sum() > 2:
            shallow.append(replace(o, imposed=o.imposed[kept], measured=o.measured[kept]))
            sds.append(sd[kept])
    return shallow, replace(fit, sds=tuple(sds))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def sentence(hidden: Sequence[Hidden], unit: str, scale: float) -> str:
    """A warning: the three alternatives that would change C10 most, by more than 1 %."""
    changes = [(float(h.change[0]), h) for h in hidden if h.change is not None and abs(h.change[0]) > LEAST_CHANGE_SHARE]
    worst = sorted(changes, key=lambda change: -abs(change[0]))[:3]
    parts = [
        f"{100.0 * abs(change):.0f} % {'higher' if change > 0.0 else 'lower'} with {h.name} (remaining misfit "
        f"{scale * h.left:.2g} {unit}, {h.left_in_noise:.2g} times the noise)"
        for change, h in worst
    ]
    return f"C10 depends on the assumptions. It would be {'; '.join(parts)}." if parts else ""
