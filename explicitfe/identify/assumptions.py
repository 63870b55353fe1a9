"""What a fit hides: how far the constants would move if something that was taken for granted were otherwise.

For each alternative the test is run once more with the fitted constants. Of the change dy of the prediction the constants can
take up a part, d theta = -(J^T W J)^-1 J^T W dy to first order; what is left over, dy + J d theta, is all that could betray it.
Where d theta is large, the step is made and the alternative run again from there, J corrected by what that shows (Broyden).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from explicitfe.errors import InputError, RunError
from explicitfe.identify.fit import Fit, Observed, Problem
from explicitfe.identify.forward import depths, forces, smoothest
from explicitfe.measured.curve import Curve
from explicitfe.predict.setup import Setup

GRAVITY = (0.0, 0.0, -9.81)
LAYER_MM, LAYER_RATIO = 1.0, 3.0
OTHER_POISSON = 0.49
ASSUMED_SHARE = 0.2
POINTS, BEYOND = 12, 1.1  # depths of a run, and how far it goes under imposed forces
PASSES, NEAR, SMALL, FARTHEST = (
    4,
    0.2,
    0.1,
    0.3,
)  # a large step is not the first order's: another run there, until the last one was small
PLATEN_DEPTH = 0.5  # of the height: deeper, free sides fold
COARSER = 0.75  # the mesh that goes with a sharper edge is this much coarser, or it would take longer than all the rest
LENGTHS = {"specimen": ("radius_mm", "height_mm", "size_mm", "layer_mm"), "tool": ("radius_mm", "edge_radius_mm")}


@dataclass(frozen=True)
class Alternative:
    """Something that may be otherwise than the fit supposes: its name in words, and the test then."""

    name: str
    setup: Setup


@dataclass(frozen=True)
class Hidden:
    """What an alternative would do to a fit.

    Attributes
    ----------
    change : (2,) of C10 and C20, relative to them; of C20 to C10 where it is 0.
    left : rms of what the constants cannot take up, in the unit of the data, SI.
    left_in_noise : the same in sds of the rows.
    problem : why there are no numbers.
    """

    name: str
    change: np.ndarray | None = None
    left: float = 0.0
    left_in_noise: float = 0.0
    problem: str = ""


def alternatives(setup: Setup, curve: Curve) -> list[Alternative]:
    """All that is worth asking of a test."""
    specimen, tool = setup.specimen, setup.tool
    assert curve.specimen is not None and curve.tool is not None
    height = specimen["height_mm"] if "height_mm" in specimen else specimen["size_mm"][2]
    found = []

    def add(name: str, body: dict[str, Any] | None = None, hand: dict[str, Any] | None = None, **more: Any) -> None:
        changed = replace(setup, specimen=specimen | (body or {}), tool=tool | (hand or {}), **more)
        found.append(Alternative(name, changed))

    if tool["shape"] == "platen" and curve.specimen.base == "unknown":
        add("sticking contact on both faces", {"base": "bonded"}, {"friction": "stick"})
    elif tool["shape"] != "bonded-disc":
        if tool["friction"] == "stick":
            add("contact without friction", hand={"friction": 0.0})
        else:
            add("sticking contact", hand={"friction": "stick"})
        if curve.specimen.base == "unknown":
            add("a sliding base", {"base": "sliding"})
    if "layer_mm" in specimen:
        add("no surface layer", {"layer_mm": 0.0, "layer_stiffness_ratio": 1.0})
    else:
        thickness = min(LAYER_MM, height / 10.0)
        name = f"a surface layer of {thickness:.3g} mm, {LAYER_RATIO:g} times as stiff"
        add(name, {"layer_mm": thickness, "layer_stiffness_ratio": LAYER_RATIO})
    add(f"Poisson's ratio {OTHER_POISSON:g}", poisson=OTHER_POISSON)
    for table, of in (("specimen", curve.specimen), ("tool", curve.tool)):
        for key in [key for key in LENGTHS[table] if key in of.assumed]:
            value = (specimen if table == "specimen" else tool).get(key)
            for share in (1.0 - ASSUMED_SHARE, 1.0 + ASSUMED_SHARE):
                # of a block the width and breadth are inferred, its thickness is where it was pressed
                changed = [share * value[0], share * value[1], value[2]] if key == "size_mm" else share * value
                name = f"{table} {key.removesuffix('_mm').replace('_', ' ')} {100.0 * (share - 1.0):+.0f} %"
                add(name, **{"body" if table == "specimen" else "hand": {key: changed}})
    if tool["shape"] == "flat-cylinder":
        half = 0.5 * tool["edge_radius_mm"]
        coarser = {"refinement": COARSER * specimen["refinement"]}
        add(f"the tool's edge rounded by {half:.2g} mm", coarser, {"edge_radius_mm": half})
    add("gravity", {"gravity_m_s2": list(GRAVITY)})
    return found


def what_a_fit_hides(
    setup: Setup,
    observed: Sequence[Observed],
    fit: Fit,
    choices: Sequence[Alternative],
    progress: Callable[[], None] = lambda: None,
) -> tuple[list[Hidden], int]:
    """Each alternative, and the number of forward runs.

    Parameters
    ----------
    setup : the test as it was fitted.
    observed, fit : curves of this test, and the constants that were fitted (to these and maybe to others).
    choices : of the same test.
    """
    if setup.tool["shape"] == "platen":
        size = setup.specimen.get("size_mm")
        limit = PLATEN_DEPTH * 1e-3 * (setup.specimen["height_mm"] if size is None else size[2])
        observed, fit = _shallow(observed, fit, limit)
    if not observed:
        return [], 0
    reach = [o.measured.max() if o.model.by_force else o.imposed.max() for o in observed]
    beyond = BEYOND if observed[0].model.by_force else 1.0
    way = depths(beyond * float(max(reach)), POINTS)
    run = forces(setup, *map(float, fit.constants), way)
    smooth = smoothest(way, [run])
    runs = 1

    def predicted(force: np.ndarray) -> np.ndarray:
        c, _ = smooth.coefficients(way, force)
        return np.concatenate([(smooth.inverse if o.model.by_force else smooth.at)(c, o.imposed)[0] for o in observed])

    # The test as it is by a run at the same depths too, for its roughness to cancel.
    here = predicted(run)
    sd = np.concatenate(fit.sds)
    start = Problem(observed, fit.sds).jacobian(fit.constants)
    unit = np.maximum(fit.constants, SMALL * fit.constants[0])
    found = []
    for choice in choices:
        constants = np.array(fit.constants)
        J, last = start.copy(), None
        try:
            for passed in range(PASSES):
                change = (predicted(forces(choice.setup, *map(float, constants), way)) - here) / sd
                runs += 1
                if last is not None:  # Broyden: what the last step has shown of the alternative's own J
                    along = (constants - last[0]) / unit**2
                    seen = change - last[1] - J @ (constants - last[0])
                    J += np.outer(seen, along) / float(along @ (constants - last[0]))
                last = constants, change
                step = _step(J, change, constants)
                left = change + J @ step
                constants = constants + step
                if (np.abs(step) < NEAR * np.maximum(last[0], SMALL * last[0][0])).all() or passed == PASSES - 1:
                    break
                constants = np.maximum(constants, [FARTHEST * last[0][0], 0.0])
            scale = np.where(fit.constants > 0.0, fit.constants, fit.constants[0])
            moved = (constants - fit.constants) / scale
            found.append(Hidden(choice.name, moved, _rms(left * sd), _rms(left)))
        except (InputError, RunError, ValueError) as error:
            found.append(Hidden(choice.name, problem=str(error).splitlines()[0]))
        progress()
    return found, runs


def _step(J: np.ndarray, change: np.ndarray, constants: np.ndarray) -> np.ndarray:
    """d theta; where C20 would fall below 0 it is held there and C10 takes the rest."""
    unit = float(constants[0])
    step = -unit * np.linalg.lstsq(unit * J, change, rcond=None)[0]
    if constants[1] + step[1] < 0.0:
        rest = change - J[:, 1] * constants[1]
        step = np.array([-float(J[:, 0] @ rest) / float(J[:, 0] @ J[:, 0]), -constants[1]])
    return step


def _shallow(observed: Sequence[Observed], fit: Fit, limit_m: float) -> tuple[list[Observed], Fit]:
    """Rows of no more than some depth."""
    some, sds = [], []
    for o, sd in zip(observed, fit.sds, strict=True):
        kept = (o.measured if o.model.by_force else o.imposed) <= limit_m
        if kept.sum() > 2:
            some.append(replace(o, imposed=o.imposed[kept], measured=o.measured[kept]))
            sds.append(sd[kept])
    return some, replace(fit, sds=tuple(sds))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def sentence(hidden: Sequence[Hidden], C10_Pa: float, unit: str, scale: float) -> str:
    """The warning that a table of alternatives amounts to: the three that move C10 furthest."""
    known = [h for h in hidden if h.change is not None]
    if not known:
        return ""
    worst = sorted(known, key=lambda h: -abs(h.change[0]))[:3]
    parts = [f"{h.name} would make C10 {100.0 * h.change[0]:+.0f} % and leave {scale * h.left:.2g} {unit}" for h in worst]
    return f"C10 is {C10_Pa:.4g} Pa only if all that was assumed is true: {'; '.join(parts)}."
