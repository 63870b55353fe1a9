"""Programmes of homogeneous tests: how a specimen is strained, and at which rows it is read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from studies.blind.grid import Conditions, HomogeneousRun, Mode

ROW_COUNT_RANGE = (50, 150)  # of a curve
FIRST_ROW_OF_HOLD_SHARE = 0.02  # The first row of a hold comes after this share of it, as relaxation is quickest there.


@dataclass(frozen=True)
class Protocol:
    """A planned test.

    Attributes
    ----------
    name, title : of the programme; they reveal nothing of the tissue.
    test : compression | tension | shear.
    mode : the quantity that is imposed.
    plan : its curves.
    shows : effects of the library that it can show.
    radius_mm : of the cylinder between platens.
    """

    name: str
    title: str
    test: str
    mode: Mode
    plan: tuple[HomogeneousRun, ...]
    shows: tuple[str, ...]
    radius_mm: float | None = None


def programme(corners: Sequence[tuple[float, float]], rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and the imposed values at them: all corners, between them even on ramps and from fine to coarse in holds."""
    t, x = (np.array(column, dtype=float) for column in zip(*corners, strict=True))
    moves = np.diff(x) != 0.0
    weight = np.where(moves, 1.0 + np.abs(np.diff(x)) / np.abs(np.diff(x)).max(), 1.0)
    counts = np.maximum(np.round(rows * weight / weight.sum()).astype(int), 4)
    times = [t[:1]]
    for k, count in enumerate(counts):
        share = np.arange(1, count + 1) / count
        if not moves[k]:
            share = np.expm1(share * np.log1p(1.0 / FIRST_ROW_OF_HOLD_SHARE)) * FIRST_ROW_OF_HOLD_SHARE
        times.append(np.round(t[k] + share * (t[k + 1] - t[k]), 6))
    time_s = np.concatenate(times)
    return time_s, np.interp(time_s, t, x)


@dataclass(frozen=True)
class _Draw:
    """The random choices that all programmes of one dataset share."""

    rng: np.random.Generator
    stretchable: bool = False
    sheared: bool = False

    def strain(self) -> float:
        """The largest strain."""
        low, high = (0.3, 0.8) if self.sheared else (0.2, 0.6) if self.stretchable else (0.2, 0.4)
        return round(float(self.rng.uniform(low, high)), 2)

    def rate(self) -> float:
        """The strain rate of the slowest ramp [1/s]."""
        return _nice(10.0 ** self.rng.uniform(-2.3, -1.0))

    def rows(self) -> int:
        return int(self.rng.integers(*ROW_COUNT_RANGE))


def _nice(value: float) -> float:
    return float(f"{value:.2g}")


# ---- programmes: strain against time, positive; each gives (corners, conditions, test) a curve ----

_Curve = tuple[list[tuple[float, float]], Conditions, int]


def _ramp_hold(draw: _Draw) -> tuple[str, list[_Curve], list[int]]:
    strain, rate = draw.strain(), draw.rate()
    faster = float(draw.rng.choice([3.0, 5.0, 10.0]))
    rates = [_nice(rate * faster**k) for k in range(3)]
    hold = _nice(draw.rng.uniform(1.0, 4.0) * strain / rates[0])
    curves: list[_Curve] = []
    repeats = int(draw.rng.integers(1, 3))
    for r in rates:
        for repeat in range(1, repeats + 1):
            ramp = strain / r
            conditions: Conditions = {"rate_per_s": r, "max_strain": strain, "hold_s": hold}
            if repeats > 1:
                conditions["repeat"] = repeat
            curves.append(([(0.0, 0.0), (ramp, strain), (ramp + hold, strain)], conditions, len(curves)))
    return "Ramp and hold at three rates", curves, list(range(repeats, 2 * repeats))


def _hold_unload_rest(draw: _Draw) -> tuple[str, list[_Curve], list[int]]:
    strain, rate = draw.strain(), draw.rate()
    hold = _nice(draw.rng.uniform(0.5, 3.0) * strain / rate)
    curves: list[_Curve] = []
    shares = [0.5, 1.0] if draw.rng.random() < 0.5 else [0.4, 0.7, 1.0]
    for share in shares:
        for r in (rate, _nice(4.0 * rate)):
            e = round(share * strain, 3)
            up, down = e / r, 2.0 * e / r + hold
            corners = [(0.0, 0.0), (up, e), (up + hold, e), (down, 0.0), (down + hold, 0.0)]
            curves.append((corners, {"rate_per_s": r, "max_strain": e, "hold_s": hold}, len(curves)))
    return "Ramp, hold, unloading and rest", curves, [2] if len(shares) == 3 else [1]


def _cycle(strain: float, rate: float, dwell: float, start: float = 0.0) -> list[tuple[float, float]]:
    up = start + strain / rate
    return [(start, 0.0), (up, strain), (up + dwell, strain), (up + dwell + strain / rate, 0.0)]


def _cycles_of_one(draw: _Draw) -> tuple[str, list[_Curve], list[int]]:
    """Cycles of growing amplitude, a curve a cycle, two specimens of one tissue."""
    strain, rate = draw.strain(), draw.rate()
    dwell = _nice(draw.rng.uniform(0.2, 1.0) * strain / rate)
    number = int(draw.rng.integers(2, 4))
    curves: list[_Curve] = []
    for specimen, r in enumerate((rate, _nice(3.0 * rate))):
        for k in range(number):
            e = round(strain * (k + 1) / number, 3)
            conditions: Conditions = {"rate_per_s": r, "hold_s": dwell, "cycle": k + 1, "sample": "AB"[specimen]}
            curves.append((_cycle(e, r, dwell), conditions, specimen))
    return "Load and unload cycles of growing amplitude", curves, []


def _cycles_in_one(draw: _Draw) -> tuple[str, list[_Curve], list[int]]:
    """Several cycles in each curve, three rates."""
    strain, rate = draw.strain(), draw.rate()
    dwell = _nice(draw.rng.uniform(0.2, 1.0) * strain / rate)
    peaks = [round(strain * share, 3) for share in ((0.5, 1.0, 0.7) if draw.rng.random() < 0.5 else (0.6, 1.0))]
    curves: list[_Curve] = []
    for r in (rate, _nice(3.0 * rate), _nice(10.0 * rate)):
        corners = [(0.0, 0.0)]
        for e in peaks:
            corners += _cycle(e, r, dwell, corners[-1][0])[1:]
        curves.append((corners, {"rate_per_s": r, "hold_s": dwell}, len(curves)))
    return "Several load and unload cycles at three rates", curves, [1]


def _ramps(draw: _Draw) -> tuple[str, list[_Curve], list[int]]:
    strain, rate = draw.strain(), draw.rate()
    curves: list[_Curve] = []
    for share in (0.5, 0.75, 1.0, 1.0)[: int(draw.rng.integers(3, 5))]:
        e = round(share * strain, 3)
        curves.append(([(0.0, 0.0), (e / rate, e)], {"rate_per_s": rate, "max_strain": e, "repeat": 1}, len(curves)))
    if len(curves) == 4:
        curves[3][1]["repeat"] = 2
    return "Ramps to several strains at one rate", curves, [1]


def _repeats(draw: _Draw) -> tuple[str, list[_Curve], list[int]]:
    strain, rate = draw.strain(), draw.rate()
    hold = _nice(draw.rng.uniform(0.5, 2.0) * strain / rate)
    number = int(draw.rng.integers(4, 7))
    up = strain / rate
    corners = [(0.0, 0.0), (up, strain), (up + hold, strain), (2.0 * up + hold, 0.0)]
    more: Conditions = {"rate_per_s": rate, "max_strain": strain, "hold_s": hold}
    return "The same test again and again", [(corners, more | {"repeat": k + 1}, k) for k in range(number)], [number // 2]


def _directions(draw: _Draw) -> tuple[str, list[_Curve], list[int]]:
    strain, rate = draw.strain(), draw.rate()
    hold = _nice(draw.rng.uniform(1.0, 3.0) * strain / rate)
    rates = (rate, _nice(3.0 * rate), _nice(10.0 * rate)) if draw.rng.random() < 0.5 else (rate, _nice(5.0 * rate))
    curves: list[_Curve] = []
    for r in rates:
        for direction in ("fibre", "cross-fibre"):
            ramp = strain / r
            conditions: Conditions = {"rate_per_s": r, "max_strain": strain, "hold_s": hold, "direction": direction}
            curves.append(([(0.0, 0.0), (ramp, strain), (ramp + hold, strain)], conditions, len(curves)))
    return "Ramp and hold along and across the fibres", curves, [2, 3] if len(rates) == 3 else []


_Programme = Callable[[_Draw], tuple[str, list[_Curve], list[int]]]
_READINGS = ("contact-offset", "compliance", "force-offset", "force-drift")
# name -> programme, effects of the material that it can show
PROGRAMMES: dict[str, tuple[_Programme, tuple[str, ...]]] = {
    "ramp-hold": (_ramp_hold, ("viscoelastic", "third-yeoh")),
    "hold-unload-rest": (_hold_unload_rest, ("viscoelastic", "softening", "third-yeoh")),
    "cycles-of-one": (_cycles_of_one, ("viscoelastic", "softening", "third-yeoh")),
    "cycles-in-one": (_cycles_in_one, ("viscoelastic", "softening", "third-yeoh")),
    "ramps": (_ramps, ("third-yeoh",)),
    "repeats": (_repeats, ("viscoelastic", "softening", "third-yeoh", "cycle-drift")),
    "directions": (_directions, ("fibres", "viscoelastic", "third-yeoh")),
}
# How a programme deforms a specimen: compressed or pulled at a point, sheared, or between platens.
DEFORMATIONS: dict[str, tuple[str, ...]] = {
    "ramp-hold": ("compression", "tension", "shear", "platen"),
    "hold-unload-rest": ("compression", "tension", "shear", "platen"),
    "cycles-of-one": ("compression", "tension", "shear", "platen"),
    "cycles-in-one": ("compression", "tension", "platen"),
    "ramps": ("compression", "tension", "shear", "platen"),
    "repeats": ("compression", "platen"),
    "directions": ("compression", "tension"),
}
EFFECTS = ("viscoelastic", "softening", "third-yeoh", "fibres", "cycle-drift", *_READINGS)


def shows(name: str, deformation: str) -> tuple[str, ...]:
    """The effects that a programme with a deformation can show."""
    # A drift of the load cell needs a hold.
    readings = [effect for effect in _READINGS if effect != "force-drift" or name != "ramps"]
    return (*PROGRAMMES[name][1], *(readings if deformation == "platen" else ()))


def draw_protocol(
    rng: np.random.Generator, needs: Sequence[str] = (), only: Sequence[str] = (), platen: bool = False
) -> Protocol:
    """Draw a protocol.

    Parameters
    ----------
    needs : effects that it has to show.
    only : programmes to choose from; all, if none are given.
    platen : whether it has to be between platens.
    """
    possible = [
        (name, deformation)
        for name, deformations in DEFORMATIONS.items()
        for deformation in deformations
        if set(needs) <= set(shows(name, deformation)) and (not only or name in only) and (deformation == "platen" or not platen)
    ]
    names = sorted({name for name, _ in possible})
    name = names[rng.integers(len(names))]
    deformations = [deformation for other, deformation in possible if other == name]
    deformation = deformations[rng.integers(len(deformations))]
    title, curves, interpolated = PROGRAMMES[name][0](_Draw(rng, deformation == "tension", deformation == "shear"))
    holds_out = bool(interpolated) and rng.random() < 0.5
    total = int(rng.integers(*ROW_COUNT_RANGE))
    radius = round(float(rng.uniform(8.0, 25.0)), 1)
    heights = _heights(rng, name, curves)
    plan = []
    for number, (corners, conditions, test) in enumerate(curves):
        time_s, strain = programme(corners, total)
        height = heights[number]
        imposed = {
            "compression": 1.0 - strain,
            "tension": 1.0 + strain,
            "shear": strain,
            "platen": np.round(height * strain, 6) * 1e-3,
        }[deformation]
        split = None if not holds_out else "holdout" if number in interpolated else "fit"
        size = {"height_m": 1e-3 * height, "area_m2": 1e-6 * np.pi * radius**2} if deformation == "platen" else {}
        plan.append(HomogeneousRun(f"curve-{number + 1}", time_s, imposed, dict(conditions), test, split, **size))
    return Protocol(
        name,
        f"{title}, {'compression between platens' if deformation == 'platen' else deformation}",
        "compression" if deformation == "platen" else deformation,
        "platen" if deformation == "platen" else "shear" if deformation == "shear" else "uniaxial",
        tuple(plan),
        shows(name, deformation),
        radius if deformation == "platen" else None,
    )


def _heights(rng: np.random.Generator, name: str, curves: Sequence[_Curve]) -> list[float]:
    """Height of the specimen of each curve [mm]; in some datasets, two."""
    first = round(float(rng.uniform(10.0, 30.0)), 1)
    if name in ("cycles-of-one", "repeats") or rng.random() < 0.5:
        return [first] * len(curves)
    return [first if number % 2 == 0 else round(0.5 * first, 2) for number in range(len(curves))]
