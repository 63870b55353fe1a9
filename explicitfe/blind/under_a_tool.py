"""One case of an indentation, simulated: drawn from its own random numbers, as in :mod:`explicitfe.blind.homogeneous`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import Chebyshev
from scipy.optimize import nnls

from explicitfe.blind.case import UNSTATED, Case, Measured, Told, Wanted, sealed
from explicitfe.blind.homogeneous import C10_PA, CORRELATED, LARGEST, RATIO, RHO, signed, strength
from explicitfe.blind.identifiable import Separation
from explicitfe.blind.noise import Noise, Whitener
from explicitfe.blind.protocols import programme
from explicitfe.blind.simulated import DATA, DENSITY_KG_M3, SCREEN, Indentation, simulate
from explicitfe.errors import RunError

CONTROLS = ("white", "correlated", "wrong-dimension")
SHOWS = {
    "force-steps": ("viscoelastic", "softening", "friction", "compliance"),
    "two-radii": (
        "viscoelastic",
        "softening",
        "friction",
        "third-yeoh",
        "compressible",
        "layer",
        "stiffness-gradient",
        "adhesion",
        "contact-offset",
        "compliance",
        "force-offset",
        "force-drift",
    ),
    "two-heights": (
        "viscoelastic",
        "softening",
        "third-yeoh",
        "compressible",
        "layer",
        "stiffness-gradient",
        "base-slip",
        "adhesion",
        "contact-offset",
        "compliance",
        "force-offset",
        "force-drift",
        "gravity",
    ),
}
EFFECTS = tuple(dict.fromkeys(name for names in SHOWS.values() for name in names))
LENGTHS = (("specimen", "radius_mm"), ("specimen", "height_mm"), ("tool", "radius_mm"))
ASSUMED = 0.3  # share of the cases in which one of them is called assumed, and is right
TRIES = 6  # draws of a case that the simulator cannot follow
STEP = 0.1  # of C10, for the sensitivity
PULL_MM = 0.4  # how far a tool is lifted off
STRAIN_ENERGY = 0.3  # I1 - 3 under the tool, about
READINGS = ("contact-offset", "compliance", "force-offset", "force-drift")
SECANT = 0.03  # of the largest force or way: size of an effect of measurement
SMOOTH = 4  # degree of the polynomials that stand for a coarse mesh's curves
TURNS = 60  # until a rig that gives way has found its place
TOUCH = 1e-3  # of the largest way or force: as good as none


Branch = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Planned:
    """A protocol under a tool, and how it is named."""

    name: str
    title: str
    curves: tuple[Indentation, ...]

    @property
    def by_force(self) -> bool:
        return self.curves[0].by_force


def choices(kind: str) -> list[tuple[str, ...]]:
    """What a kind can be; cases go round this list."""
    return [(name,) for name in (CONTROLS if kind == "control" else EFFECTS)]


def draw(rng: np.random.Generator, wanted: Wanted) -> Case:
    """A case of that kind; drawn anew where the simulator does not reach a state."""
    for _ in range(TRIES - 1):
        try:
            return _draw(rng, wanted)
        except RunError:
            continue
    return _draw(rng, wanted)


def _draw(rng: np.random.Generator, wanted: Wanted) -> Case:
    C10 = float(f"{np.exp(rng.uniform(*np.log(C10_PA))):.4g}")
    C20 = float(f"{rng.uniform(0.0, RATIO) * C10:.4g}")
    planned = _protocol(rng, wanted, C10)
    screened = np.concatenate(simulate(planned.curves, (C10, C20), {}, SCREEN))
    effects = {} if wanted.kind == "control" else {wanted.what[0]: _effect(rng, wanted.what[0], planned, screened, C10, C20)}
    whole = simulate(planned.curves, (C10, C20), effects, DATA)
    largest = float(np.abs(np.concatenate(whole)).max())
    correlated = wanted.what == ("correlated",) or (wanted.kind != "control" and rng.random() < CORRELATED)
    noise = Noise(wanted.level, wanted.level * largest, round(float(rng.uniform(*RHO)), 3) if correlated else 0.0)
    measured = noise.added(rng, whole)
    told = Told(rng.random() >= UNSTATED)
    wrong = None
    assumed = LENGTHS[rng.integers(len(LENGTHS))] if rng.random() < ASSUMED else None
    if wanted.what == ("wrong-dimension",):
        assumed = LENGTHS[rng.integers(len(LENGTHS))]
        factor = float(1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.03, 0.10))
        wrong = {"where": assumed[0], "key": assumed[1], "factor": factor}
    apart = None if wanted.kind == "control" else _separation(planned, (C10, C20), effects, screened, noise)
    keys = ("displacement_sd_mm", "force_sd_N") if planned.by_force else ("force_sd_N", "displacement_sd_mm")
    specimen, tool, own = _tables(planned, wrong, assumed)
    truth = sealed(wanted, effects, (C10, C20), noise, told, apart) | {
        "protocol": planned.name,
        "mode": "indentation",
        "test": "indentation",
        "holdout": any(curve.split == "holdout" for curve in planned.curves),
        "rows": {curve.id: len(curve.rows) for curve in planned.curves},
        "wrong": wrong,
    }
    return Case(
        title=planned.title,
        test="indentation",
        columns=("displacement_mm", "force_N"),
        specimen=specimen,
        tool=tool,
        noise=told.table(noise, *keys, factor=1e3 if planned.by_force else 1.0),
        curves=[_measured(curve, values, own[k]) for k, (curve, values) in enumerate(zip(planned.curves, measured, strict=True))],
        truth=truth,
    )


def _measured(curve: Indentation, values: np.ndarray, own: dict[str, dict[str, Any]]) -> Measured:
    columns = (1e3 * values, curve.imposed) if curve.by_force else (curve.imposed, values)
    group = f"specimen-{curve.test + 1}"
    return Measured(curve.id, np.column_stack([curve.rows, *columns]), group, curve.split, curve.conditions, own)


def _tables(
    planned: Planned, wrong: dict[str, Any] | None, assumed: tuple[str, str] | None
) -> tuple[dict[str, Any], dict[str, Any], list[dict[str, dict[str, Any]]]]:
    """[specimen] and [tool] as the dataset states them, and what differs from curve to curve."""

    def stated(curve: Indentation) -> dict[str, dict[str, Any]]:
        found: dict[str, dict[str, Any]] = {"specimen": dict(curve.specimen), "tool": dict(curve.tool)}
        if wrong is not None:
            found[wrong["where"]][wrong["key"]] = round(found[wrong["where"]][wrong["key"]] * wrong["factor"], 3)
        return found

    every = [stated(curve) for curve in planned.curves]
    own = [
        {where: {k: v for k, v in table.items() if v != every[0][where][k]} for where, table in tables.items()}
        for tables in every
    ]
    specimen = {"shape": "cylinder", **every[0]["specimen"], "density_kg_m3": DENSITY_KG_M3, "base": "unknown"}
    tool = {**every[0]["tool"], "control": "force" if planned.by_force else "displacement"}
    if assumed is not None:
        (specimen if assumed[0] == "specimen" else tool)["assumed"] = [assumed[1]]
    return specimen, tool, [{where: table for where, table in mine.items() if table} for mine in own]


# ---- protocols ----


def _protocol(rng: np.random.Generator, wanted: Wanted, C10_Pa: float) -> Planned:
    names = [name for name, shown in SHOWS.items() if wanted.kind == "control" or wanted.what[0] in shown]
    name = names[rng.integers(len(names))]
    if name == "force-steps":
        return _force_steps(rng, C10_Pa)
    flat = rng.random() < 0.6
    radius, height = (35.0, 20.0) if flat else (30.0, 25.0)
    first = 12.0 if flat else 10.0
    sizes = (first, 0.5 * first) if name == "two-radii" else (first, first)
    heights = (height, height) if name == "two-radii" else (height, 0.5 * height)
    rate = float(rng.choice([0.2, 0.5, 1.0]))
    hold = float(rng.choice([10.0, 20.0, 40.0]))
    curves: list[Indentation] = []
    # the same two tests at two rates, or once
    rates = (rate, 5.0 * rate) if rng.random() < 0.5 else (rate,)
    for r in rates:
        for size, h in zip(sizes, heights, strict=True):
            depth = round(float(min(0.3 * h, 0.5 * size)), 2)
            up, down = depth / r, (depth + PULL_MM) / r
            corners = ((0.0, 0.0), (up, depth), (up + hold, depth), (up + hold + down, -PULL_MM))
            rows, _ = programme(corners, int(rng.integers(30, 55)))
            tool: dict[str, Any] = {"shape": "flat-cylinder" if flat else "sphere", "radius_mm": size}
            if flat:
                tool["edge_radius_mm"] = 1.0
            conditions = {"rate_mm_per_s": r, "max_displacement_mm": depth, "hold_s": hold}
            table = {"radius_mm": radius, "height_mm": h}
            number = len(curves)
            curves.append(Indentation(f"curve-{number + 1}", table, tool, corners, False, rows, conditions, number, None))
    title = (
        f"Indentation with {'two tools' if name == 'two-radii' else 'one tool, specimens of two heights'}: ramp, hold, unloading"
    )
    return Planned(name, title, tuple(curves))


def _force_steps(rng: np.random.Generator, C10_Pa: float) -> Planned:
    """Eight dwelled force steps up and down, two cycles; two rows a step: when it begins to dwell, and when it is left."""
    step = float(f"{0.1 * C10_Pa / 191.5:.3g}")
    ramp, dwell = 1.0, float(rng.choice([5.0, 10.0, 30.0]))
    loads = step * np.array([1, 2, 3, 4, 5, 6, 7, 8, 7, 6, 5, 4, 3, 2, 1, 0], dtype=float)
    corners = [(0.0, 0.0)]
    for load in loads:
        corners += [(corners[-1][0] + ramp, float(load)), (corners[-1][0] + ramp + dwell, float(load))]
    rows = np.array([t for t, _ in corners])
    specimen, tool = {"radius_mm": 35.0, "height_mm": 20.0}, {"shape": "flat-cylinder", "radius_mm": 14.0, "edge_radius_mm": 1.0}
    curves = [
        Indentation(f"cycle-{k + 1}", specimen, tool, tuple(corners), True, rows, {"hold_s": dwell, "cycle": k + 1}, 0, None)
        for k in range(2)
    ]
    return Planned("force-steps", "Indentation by dwelled force steps, up and down, two cycles", tuple(curves))


# ---- effects ----


def _effect(
    rng: np.random.Generator, name: str, planned: Planned, screened: np.ndarray, C10_Pa: float, C20_Pa: float
) -> dict[str, Any]:
    """Parameters of an effect, from weak to strong."""
    span = max(float(curve.rows[-1]) for curve in planned.curves)
    force, depth = _scales(planned, screened)
    G, x = 2.0 * C10_Pa, STRAIN_ENERGY
    height = max(curve.specimen["height_mm"] for curve in planned.curves)
    most = LARGEST.get(name, np.inf)
    if name == "viscoelastic":
        return {"g": [strength(rng, 0.05, 0.5)], "tau_s": [strength(rng, 0.02 * span, 0.5 * span)]}
    if name == "softening":
        return {"inverse_r": strength(rng, 0.1, 0.7), "m_Pa": strength(rng, 0.02 * x * C10_Pa, 0.3 * x * C10_Pa)}
    if name == "friction":
        return {"coefficient": strength(rng, 0.05, 1.0)}
    if name == "third-yeoh":
        whole = (C10_Pa + 2.0 * C20_Pa * x) / (3.0 * x**2)
        return {"C30_Pa": strength(rng, 0.05 * whole, whole, most)}
    if name == "compressible":
        return {"poisson": 0.5 * (1.0 - strength(rng, 0.01, 0.3))}
    if name == "layer":
        return {"thickness_mm": strength(rng, 0.5, 4.0), "ratio": strength(rng, 1.3, 6.0) ** float(rng.choice([-1.0, 1.0]))}
    if name == "stiffness-gradient":
        return {"g": signed(rng, 0.05, 0.7)}
    if name == "base-slip":
        return {"compliance_mm_kPa": strength(rng, 50.0 * height / G, 5e3 * height / G, most)}
    if name == "adhesion":
        return {"stress_Pa": strength(rng, 0.02 * G, 0.4 * G, most)}
    if name == "contact-offset":
        return {"offset_mm": signed(rng, 0.01 * depth, 0.15 * depth, most)}
    if name == "compliance":
        return {"compliance_mm_N": strength(rng, 0.005 * depth / force, 0.2 * depth / force, most)}
    if name == "force-offset":
        return {"offset_N": signed(rng, 0.005 * force, 0.2 * force, most)}
    if name == "force-drift":
        return {"rate_N_s": signed(rng, 0.01 * force / span, 0.2 * force / span, most)}
    assert name == "gravity"
    return {"acceleration_m_s2": 9.81}


# ---- separations, all as differences of runs on one coarse mesh ----


def _rivals(planned: Planned, C10_Pa: float) -> dict[str, list[dict[str, Any]]]:
    """Shapes of each rival whose secants stand for it."""
    span = max(float(curve.rows[-1]) for curve in planned.curves)
    G, x = 2.0 * C10_Pa, STRAIN_ENERGY
    height = max(curve.specimen["height_mm"] for curve in planned.curves)
    slip = 1e3 * height / G
    found: dict[str, list[dict[str, Any]]] = {
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
    if not planned.by_force:
        found["adhesion"] = [{"stress_Pa": min(0.1 * G, 500.0)}]
    return found


def _sizes(planned: Planned, screened: np.ndarray) -> dict[str, tuple[float, ...]]:
    """Sizes of the effects of measurement whose secants stand for them."""
    force, depth = _scales(planned, screened)
    span = max(float(curve.rows[-1]) for curve in planned.curves)
    both = np.array([1.0, -1.0]) * SECANT
    return {
        "contact-offset": tuple(depth * both),
        "compliance": (SECANT * depth / force,),
        "force-offset": tuple(force * both),
        "force-drift": tuple(force / span * both),
        "preload": (SECANT * force,),
    }


def _smooth(planned: Planned, change: np.ndarray) -> np.ndarray:
    """Changes without the steps of a coarse mesh: on each way a polynomial of what is imposed; waits stay as they are."""
    parts = _split(planned, change)
    for curve, part in zip(planned.curves, parts, strict=True):
        rising = np.arange(len(part)) <= int(np.argmax(curve.imposed))
        if curve.by_force:
            # of each step the row where the dwell begins, and the one where it ends
            last = np.arange(len(part)) % 2 == 0
            ways = [way & row for way in (rising, ~rising) for row in (last, ~last)]
        else:
            moving = curve.imposed < curve.imposed.max()
            ways = [rising & moving, ~rising & moving]
        for way in ways:
            here = way & (curve.imposed > 0.0)
            if here.sum() > SMOOTH + 1:
                part[here] = Chebyshev.fit(curve.imposed[here], part[here], SMOOTH)(curve.imposed[here])
    return np.concatenate(parts)


def _scales(planned: Planned, screened: np.ndarray) -> tuple[float, float]:
    """Largest force [N] and depth [mm]."""
    imposed, answer = max(float(curve.imposed.max()) for curve in planned.curves), float(np.abs(screened).max())
    return (imposed, 1e3 * answer) if planned.by_force else (answer, imposed)


def _split(planned: Planned, values: np.ndarray) -> list[np.ndarray]:
    return np.split(values, np.cumsum([len(curve.rows) for curve in planned.curves])[:-1])


def _separation(
    planned: Planned, constants: tuple[float, float], effects: dict[str, Any], screened: np.ndarray, noise: Noise
) -> Separation:
    """Of the hidden effect from the law alone, and from the best non-negative sum of the secants of each other effect."""
    C10, C20 = constants

    def run(first: float, second: float, more: dict[str, Any]) -> np.ndarray | None:
        # a layer has a mesh of its own: it is compared with one that is as stiff as what is below
        same = {name: parameters | {"ratio": 1.0} for name, parameters in more.items() if name == "layer"}
        try:
            found = np.concatenate(simulate(planned.curves, (first, second), more, SCREEN))
            without = np.concatenate(simulate(planned.curves, constants, same, SCREEN)) if same else screened
            return _smooth(planned, found - without)
        except RunError:  # a rival that cannot be computed here cannot stand for the truth either
            return None

    read = _readings(planned, screened)
    name = next(iter(effects))
    true = read(name, next(iter(effects[name].values()))) if name in READINGS else run(C10, C20, effects)
    slopes = [run(C10 * (1.0 + STEP), C20, {}), run(C10, C20 + STEP * C10, {})]
    if true is None or slopes[0] is None or slopes[1] is None:
        raise RunError("the coarse numerics do not follow the truth.")
    whiten = Whitener(noise, _split(planned, true + screened), [curve.split != "holdout" for curve in planned.curves])
    J = np.column_stack([whiten(slope) for slope in slopes])
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
    found = {}
    for name, shapes in _rivals(planned, C10).items():
        if name not in effects:
            prints = [run(C10, C20, {name: shape}) for shape in shapes]
            found[name] = apart([column for column in prints if column is not None])
    for name, sizes in _sizes(planned, screened).items():
        if name not in effects:
            found[name] = apart([read(name, size) for size in sizes])
    return Separation(baseline, found)


def _readings(planned: Planned, screened: np.ndarray) -> Callable[[str, float], np.ndarray]:
    """What an effect of measurement of a size changes at all rows, by the elastic curves themselves, made smooth.

    A coarse mesh makes steps where the next points touch: they would be taken for the shift of a curve.
    """
    branches = [_branch(curve, answer) for curve, answer in zip(planned.curves, _split(planned, screened), strict=True)]
    change = _shifted if planned.by_force else _read
    return lambda name, size: np.concatenate(
        [change(curve, at, name, size) for curve, at in zip(planned.curves, branches, strict=True)]
    )


def _branch(curve: Indentation, answer: np.ndarray) -> Branch:
    """What the elastic law answers to anything imposed: nothing without contact, beyond the largest along the tangent."""
    # rows of a hold and of the way back repeat what is imposed
    x, first = np.unique(np.round(curve.imposed, 9), return_index=True)
    touching = x > TOUCH * x[-1]
    x, y = x[touching], answer[first][touching]
    top = x[-1]
    share = Chebyshev.fit(np.sqrt(x / top), y / x, SMOOTH, domain=[0.0, 1.0])

    def inside(way: np.ndarray) -> np.ndarray:
        return way * share(np.sqrt(way / top))

    slope = float((inside(np.array(top)) - inside(np.array((1.0 - TOUCH) * top))) / (TOUCH * top))
    return lambda imposed: inside(np.clip(imposed, 0.0, top)) + slope * np.maximum(imposed - top, 0.0)


def _read(curve: Indentation, at: Branch, name: str, size: float) -> np.ndarray:
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
    for _ in range(TURNS if name == "compliance" else 0):
        tool = 0.5 * (tool + now - size * at(tool))
    return at(tool) - at(now)


def _shifted(curve: Indentation, at: Branch, name: str, size: float) -> np.ndarray:
    """Change of the displacement [m] at imposed forces [N]."""
    now = curve.imposed
    if name == "contact-offset":
        return np.full(len(now), -1e-3 * size)
    if name == "compliance":
        return 1e-3 * size * now
    if name == "preload":
        return -at(np.full(len(now), size))
    return at(now - size * (curve.rows if name == "force-drift" else 1.0)) - at(now)
