"""How far the curves of a test under a tool stay from what could stand for them, by runs on one coarse mesh."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.polynomial import Chebyshev
from scipy.optimize import nnls

from explicitfe.platform.errors import RunError
from studies.blind.grid import Parameters
from studies.blind.identifiable import Separation
from studies.blind.noise import Noise, Whitener
from studies.blind.simulated import SCREENING_MESH, SimulatedTest, simulate
from studies.blind.tool_protocols import ToolProtocol

SENSITIVITY_STEP_SHARE = 0.1  # of C10: the change of a constant whose secant is its sensitivity
TYPICAL_I1_MINUS_3 = 0.3  # I1 - 3 under the tool is about this large; it scales the strengths of nonlinear effects.
READING_EFFECTS = ("contact-offset", "compliance", "force-offset", "force-drift")
SECANT_SHARE = 0.03  # of the largest force or depth: the size of a measurement effect whose secant stands for it
POLYNOMIAL_DEGREE = 4  # of the polynomials that smooth the curves of a coarse mesh
RIG_ITERATIONS = 60  # Each halves the error of the displacement of a rig with compliance, to below rounding.
TOUCHING_SHARE = 1e-3  # of the largest force or depth: below it the tool as good as does not touch

Branch = Callable[[np.ndarray], np.ndarray]


def _rivals(protocol: ToolProtocol, C10_Pa: float) -> dict[str, list[Parameters]]:
    """Parameters of each rival; the secant to each of them stands for the rival."""
    span = max(float(curve.rows[-1]) for curve in protocol.curves)
    G, x = 2.0 * C10_Pa, TYPICAL_I1_MINUS_3
    height = max(curve.specimen["height_mm"] for curve in protocol.curves)
    slip = 1e3 * height / G
    shapes: dict[str, list[Parameters]] = {
        "viscoelastic": [{"g": [0.2], "tau_s": [share * span]} for share in (0.02, 0.1, 0.5)],
        "softening": [{"inverse_r": 0.3, "m_Pa": share * x * C10_Pa} for share in (0.03, 0.3)],
        "friction": [{"coefficient": mu} for mu in (0.2, 0.8)],
        "third-yeoh": [{"C30_Pa": 0.3 * C10_Pa / (3.0 * x**2)}],
        "compressible": [{"poisson": nu} for nu in (0.49, 0.44)],
        "layer": [{"thickness_mm": 1.0, "ratio": 3.0}, {"thickness_mm": 3.0, "ratio": 2.0}, {"thickness_mm": 2.0, "ratio": 0.4}],
        "stiffness-gradient": [{"g": g} for g in (0.4, -0.4)],
        "base-slip": [{"compliance_mm_kPa": min(share * slip, 100.0)} for share in (0.2, 2.0)],
        "gravity": [{"acceleration_m_s2": 9.81}],
    }
    if not protocol.by_force:
        shapes["adhesion"] = [{"stress_Pa": min(0.1 * G, 500.0)}]
    return shapes


def _sizes(protocol: ToolProtocol, screened: np.ndarray) -> dict[str, tuple[float, ...]]:
    """Sizes of the effects of measurement; the secant to each of them stands for the effect."""
    force, depth = largest_force_and_depth(protocol, screened)
    span = max(float(curve.rows[-1]) for curve in protocol.curves)
    both = np.array([1.0, -1.0]) * SECANT_SHARE
    return {
        "contact-offset": tuple(depth * both),
        "compliance": (SECANT_SHARE * depth / force,),
        "force-offset": tuple(force * both),
        "force-drift": tuple(force / span * both),
        "preload": (SECANT_SHARE * force,),
    }


def _smooth(protocol: ToolProtocol, change: np.ndarray) -> np.ndarray:
    """The changes without the steps of a coarse mesh: each branch becomes a polynomial, holds stay as they are."""
    parts = _split(protocol, change)
    for curve, part in zip(protocol.curves, parts, strict=True):
        rising = np.arange(len(part)) <= int(np.argmax(curve.imposed))
        if curve.by_force:
            # Each step of force has a row where the dwell begins, and one where it ends.
            last = np.arange(len(part)) % 2 == 0
            branches = [branch & row for branch in (rising, ~rising) for row in (last, ~last)]
        else:
            moving = curve.imposed < curve.imposed.max()
            branches = [rising & moving, ~rising & moving]
        for branch in branches:
            here = branch & (curve.imposed > 0.0)
            if here.sum() > POLYNOMIAL_DEGREE + 1:
                part[here] = Chebyshev.fit(curve.imposed[here], part[here], POLYNOMIAL_DEGREE)(curve.imposed[here])
    return np.concatenate(parts)


def largest_force_and_depth(protocol: ToolProtocol, screened: np.ndarray) -> tuple[float, float]:
    """Largest force [N] and depth [mm]."""
    imposed, answer = max(float(curve.imposed.max()) for curve in protocol.curves), float(np.abs(screened).max())
    return (imposed, 1e3 * answer) if protocol.by_force else (answer, imposed)


def _split(protocol: ToolProtocol, values: np.ndarray) -> list[np.ndarray]:
    return np.split(values, np.cumsum([len(curve.rows) for curve in protocol.curves])[:-1])


def tool_separation(
    protocol: ToolProtocol, constants: tuple[float, float], effects: Mapping[str, Parameters], screened: np.ndarray, noise: Noise
) -> Separation:
    """How far the curves with the hidden effect stay from the law alone, and from each other effect.

    Another effect is represented by the best non-negative sum of its secants.
    """
    C10, C20 = constants

    def run(first: float, second: float, more: Mapping[str, Parameters]) -> np.ndarray | None:
        # A layer has a mesh of its own: it is compared with a layer that is as stiff as the tissue below.
        same = {name: parameters | {"ratio": 1.0} for name, parameters in more.items() if name == "layer"}
        try:
            answers = np.concatenate(simulate(protocol.curves, (first, second), more, SCREENING_MESH))
            without = np.concatenate(simulate(protocol.curves, constants, same, SCREENING_MESH)) if same else screened
            return _smooth(protocol, answers - without)
        except RunError:  # A rival that cannot be computed here cannot stand for the truth either.
            return None

    read = _readings(protocol, screened)
    name = next(iter(effects))
    true = read(name, next(iter(effects[name].values()))) if name in READING_EFFECTS else run(C10, C20, effects)
    slopes = [run(C10 * (1.0 + SENSITIVITY_STEP_SHARE), C20, {}), run(C10, C20 + SENSITIVITY_STEP_SHARE * C10, {})]
    if true is None or slopes[0] is None or slopes[1] is None:
        raise RunError("the test could not be computed on the coarse mesh.")
    whiten = Whitener(noise, _split(protocol, true + screened), [curve.split != "holdout" for curve in protocol.curves])
    J = np.column_stack([whiten(slope) for slope in slopes if slope is not None])
    Q, _ = np.linalg.qr(J)

    def apart(columns: Sequence[np.ndarray]) -> float:
        target = whiten(true)
        target = target - Q @ (Q.T @ target)
        if not columns:
            return float(target @ target)
        prints = np.column_stack([whiten(column) for column in columns])
        prints = prints - Q @ (Q.T @ prints)
        size = np.maximum(np.linalg.norm(prints, axis=0), 1e-12)
        return float(nnls(prints / size, target)[1] ** 2)

    baseline = apart([])
    rivals = {}
    for name, shapes in _rivals(protocol, C10).items():
        if name not in effects:
            prints = [run(C10, C20, {name: shape}) for shape in shapes]
            rivals[name] = apart([column for column in prints if column is not None])
    for name, sizes in _sizes(protocol, screened).items():
        if name not in effects:
            rivals[name] = apart([read(name, size) for size in sizes])
    return Separation(baseline, rivals)


def _readings(protocol: ToolProtocol, screened: np.ndarray) -> Callable[[str, float], np.ndarray]:
    """A function of an effect of measurement and its size, which gives the change at all rows.

    The change follows from the elastic curves, made smooth: where further points of a coarse mesh touch the tool, its curve has a
    step, which would be taken for the shift of a curve.
    """
    branches = [_branch(curve, answer) for curve, answer in zip(protocol.curves, _split(protocol, screened), strict=True)]
    change = _change_of_displacement if protocol.by_force else _change_of_force
    return lambda name, size: np.concatenate(
        [change(curve, at, name, size) for curve, at in zip(protocol.curves, branches, strict=True)]
    )


def _branch(curve: SimulatedTest, answer: np.ndarray) -> Branch:
    """The elastic answer to an imposed value: zero without contact, along the tangent beyond the largest value."""
    # Rows of a hold and of the unloading repeat imposed values: each value counts once.
    x, first = np.unique(np.round(curve.imposed, 9), return_index=True)
    touching = x > TOUCHING_SHARE * x[-1]
    x, y = x[touching], answer[first][touching]
    top = x[-1]
    share = Chebyshev.fit(np.sqrt(x / top), y / x, POLYNOMIAL_DEGREE, domain=[0.0, 1.0])

    def inside(size: np.ndarray) -> np.ndarray:
        return size * share(np.sqrt(size / top))

    slope = float((inside(np.array(top)) - inside(np.array((1.0 - TOUCHING_SHARE) * top))) / (TOUCHING_SHARE * top))
    return lambda imposed: inside(np.clip(imposed, 0.0, top)) + slope * np.maximum(imposed - top, 0.0)


def _change_of_force(curve: SimulatedTest, at: Branch, name: str, size: float) -> np.ndarray:
    """Change of the force [N] at imposed displacements [mm]."""
    now = curve.imposed
    if name == "force-offset":
        return np.full(len(now), size)
    if name == "force-drift":
        return size * curve.rows
    tool = now
    if name == "contact-offset":
        tool = now + size
    elif name == "preload":
        ways = np.linspace(0.0, now.max(), 500)
        tool = now + np.interp(size, at(ways), ways)
    for _ in range(RIG_ITERATIONS if name == "compliance" else 0):
        tool = 0.5 * (tool + now - size * at(tool))
    return at(tool) - at(now)


def _change_of_displacement(curve: SimulatedTest, at: Branch, name: str, size: float) -> np.ndarray:
    """Change of the displacement [m] at imposed forces [N]."""
    now = curve.imposed
    if name == "contact-offset":
        return np.full(len(now), -1e-3 * size)
    if name == "compliance":
        return 1e-3 * size * now
    if name == "preload":
        return -at(np.full(len(now), size))
    return at(now - size * (curve.rows if name == "force-drift" else 1.0)) - at(now)
