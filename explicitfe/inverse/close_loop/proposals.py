"""Tests that could be made next, within the limits of a rig: like one that was made, each with something changed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from explicitfe.inverse.close_loop.specimens.lengths import with_length
from explicitfe.inverse.close_loop.specimens.series import distance_from_rest, rest_of
from explicitfe.inverse.measured.curve import Curve, programme_of
from explicitfe.inverse.measured.tables import RigLimits
from explicitfe.inverse.predict.experiment import cycle_of

# Where a rig states no limits: the largest load that was reached may be exceeded by so much, and a ramp be so many times faster
# than the fastest that was made, a test so many times longer than the longest.
LOAD_FACTOR, PACE_FACTOR, DURATION_FACTOR = 1.3, 10.0, 10.0
# Holds last so many times the test, and a tool or a specimen of this share of the size is proposed where none is stated.
HOLD_FACTOR, SIZE_SHARE = 3.0, 0.5
# Rows of a piece of a programme, and the first of those of a hold, as a share of the hold.
PIECE_ROWS = 40
FIRST_HOLD_SHARE = 0.01
# Conditions that no longer hold once a programme is changed.
CHANGED_CONDITIONS = (
    "rate_per_s",
    "rate_mm_per_s",
    "max_strain",
    "max_stretch",
    "max_displacement_mm",
    "hold_s",
    "cycle",
    "defect",
)
SECONDS_PER_MINUTE = 60.0
# Cycles of a programme of many pieces.
MANY_CYCLES = 4
# What changes from repeat to repeat shows after so many more of them, which need not be read.
SKIPPED_REPEATS = 8


@dataclass(frozen=True, eq=False)
class ProposedCurve:
    """A test that could be made: in words, and as a curve of which only the programme counts."""

    words: str
    curve: Curve
    skipped: int = 0

    def minutes(self, limits: RigLimits) -> float:
        """What it costs, set up and run, with the repeats before it that are not read."""
        return limits.handling_min + (1 + self.skipped) * float(self.curve.time_s[-1]) / SECONDS_PER_MINUTE


@dataclass(frozen=True)
class Room:
    """What a rig can do in the terms of a programme: SI, strain or displacement or force as it is imposed.

    Attributes
    ----------
    load : the largest distance from rest.
    ramp_s, test_s : the shortest time to it, and the longest of a test.
    """

    load: float
    ramp_s: float
    test_s: float


def room_of(curves: tuple[Curve, ...], limits: RigLimits) -> Room:
    """The room that a rig has, or that the tests made on it show."""
    reached = max(_load(c) for c in curves)
    first = curves[0]
    if first.kind != "force-displacement":
        load = limits.largest_strain
    elif first.imposed == "force_N":
        load = limits.largest_force_N
    else:
        load = None if limits.largest_displacement_mm is None else 1e-3 * limits.largest_displacement_mm
    fastest = min(_ramp(c)[0][-1] for c in curves)
    longest = max(float(c.time_s[-1]) for c in curves)
    return Room(
        LOAD_FACTOR * reached if load is None else load,
        limits.shortest_ramp_s or fastest / PACE_FACTOR,
        limits.longest_test_s or DURATION_FACTOR * longest,
    )


def proposals(curves: tuple[Curve, ...], limits: RigLimits) -> Iterator[ProposedCurve]:
    """All tests that are compared: like the longest of those that were made, within the room that there is."""
    room = room_of(curves, limits)
    source = max(curves, key=lambda c: float(c.time_s[-1]))
    for words, curve in _changed(source, curves, room, limits):
        if curve.time_s[-1] <= room.test_s * (1.0 + 1e-9):
            skipped = SKIPPED_REPEATS if cycle_of(curve) > cycle_of(source) else 0
            planned = replace(curve, id="proposed", file="proposed.csv", split="fit")
            yield ProposedCurve(f"{words} (as {source.id})", planned, skipped)


def _changed(source: Curve, curves: tuple[Curve, ...], room: Room, limits: RigLimits) -> Iterator[tuple[str, Curve]]:
    ramp_s = float(_ramp(source)[0][-1])
    fast = max(room.ramp_s, ramp_s / PACE_FACTOR)
    load = min(_load(source), room.load)
    hold_s = min(HOLD_FACTOR * float(source.time_s[-1]), 0.5 * room.test_s)
    yield f"a ramp {ramp_s / fast:.3g} times faster", _course(source, [(fast, load)])
    yield f"a ramp {PACE_FACTOR:g} times slower", _course(source, [(PACE_FACTOR * ramp_s, load)])
    yield f"a fast ramp, then a hold of {hold_s:.3g} s", _course(source, [(fast, load), (hold_s, load)])
    yield "loading and unloading as fast, then rest", _course(source, [(ramp_s, load), (ramp_s, 0.0), (ramp_s, 0.0)])
    half = 0.5 * load
    growing = [(ramp_s, half), (ramp_s, 0.0), (2.0 * ramp_s, load), (2.0 * ramp_s, 0.0), (2.0 * ramp_s, load)]
    yield "cycles to half the load, to all of it, and again", _course(source, growing)
    steps = [(k_s, share * load) for share in (0.33, 0.67, 1.0) for k_s in (fast, hold_s / 3.0)]
    yield "fast steps to a third, two thirds and all of the load, each held", _course(source, steps)
    everything = [(fast, load), (hold_s, load), (fast, 0.0), (0.5 * hold_s, 0.0), (ramp_s, load)]
    yield f"a fast ramp, a hold of {hold_s:.3g} s, unloading, rest and a slow ramp", _course(source, everything)
    if room.load > load * (1.0 + 1e-9):
        more = room.load / load
        yield f"{more:.3g} times the largest load, and back", _course(source, [(more * ramp_s, room.load), (more * ramp_s, 0.0)])
    if source.tool is None or source.tool.shape == "platen":
        yield from _of_many_pieces(source, room, ramp_s)
    last = max(cycle_of(c) for c in curves)
    if last > min(cycle_of(c) for c in curves):
        again = replace(source, conditions={**source.conditions, "repeat": int(last) + 1 + SKIPPED_REPEATS})
        yield f"the same again after {SKIPPED_REPEATS} more repeats", _course(again, [(ramp_s, load), (ramp_s, 0.0)])
    yield from _of_other_directions(source, curves, ramp_s, load)
    yield from _of_other_sizes(source, curves, limits, ramp_s, load)


def _of_many_pieces(source: Curve, room: Room, ramp_s: float) -> Iterator[tuple[str, Curve]]:
    """Long programmes to the largest load: once a test is set up, a further piece of it costs only its own duration.

    Under a tool each piece costs the run of a mesh, so these are only for tests that need none, or little of it.
    """
    most = room.load
    ramp_s = ramp_s * most / max(_load(source), 1e-300)
    fast = max(room.ramp_s, ramp_s / PACE_FACTOR)
    hold_s = min(HOLD_FACTOR * float(source.time_s[-1]), 0.2 * room.test_s)
    slow = min(PACE_FACTOR * ramp_s, 0.3 * room.test_s)
    words = f"to {most / max(_load(source), 1e-300):.3g} times the largest load"
    paces = [piece for pace in (fast, ramp_s, slow) for piece in ((pace, most), (pace, 0.0))]
    yield f"rest, then a cycle at each of three paces over two decades {words}", _course(source, [(ramp_s, 0.0), *paces])
    cycles = [piece for _ in range(MANY_CYCLES) for piece in ((ramp_s, most), (ramp_s, 0.0))]
    yield f"{MANY_CYCLES} cycles {words}", _course(source, cycles)
    cycles = [piece for _ in range(MANY_CYCLES) for piece in ((fast, most), (fast, 0.0))]
    yield f"{MANY_CYCLES} fast cycles {words}, then rest", _course(source, [*cycles, (hold_s, 0.0)])
    stairs = (0.33, 0.67, 1.0, 0.67, 0.33, 0.0)
    steps = [piece for share in stairs for piece in ((fast, share * most), (hold_s / 3.0, share * most))]
    yield f"fast steps up and down, each held, {words}", _course(source, steps)
    growing = [piece for share in (0.5, 0.5, 1.0, 1.0) for piece in ((share * ramp_s, share * most), (share * ramp_s, 0.0))]
    yield f"two cycles to half and two to all of it, then rest, {words}", _course(source, [*growing, (hold_s, 0.0)])
    held = [(fast, most), (hold_s, most), (fast, 0.0), (hold_s, 0.0), (ramp_s, most), (ramp_s, 0.0)]
    yield f"a fast ramp, a hold of {hold_s:.3g} s, unloading, as long a rest and a slow cycle {words}", _course(source, held)


def _of_other_directions(source: Curve, curves: tuple[Curve, ...], ramp_s: float, load: float) -> Iterator[tuple[str, Curve]]:
    """The same along another direction of the tissue, where tests have directions."""
    for name in dict.fromkeys(str(c.conditions["direction"]) for c in curves if "direction" in c.conditions):
        if name != source.conditions.get("direction"):
            yield f"the same in the direction {name}", _course(_with(source, direction=name), [(ramp_s, load), (ramp_s, 0.0)])


def _of_other_sizes(
    source: Curve, curves: tuple[Curve, ...], limits: RigLimits, ramp_s: float, load: float
) -> Iterator[tuple[str, Curve]]:
    """Another tool or specimen: of those at hand, or of half the size; a smaller one with as much smaller a load."""
    for table, key, stated, what in (
        ("tool", "radius_mm", limits.tool_radii_mm, "a tool of {:.3g} mm radius"),
        ("specimen", "height_mm", limits.specimen_heights_mm, "a specimen {:.3g} mm high"),
    ):
        own = getattr(getattr(source, table), key, None)
        if source.kind != "force-displacement" or not isinstance(own, int | float):
            continue
        tested = {getattr(getattr(c, table), key, None) for c in curves}
        for size in stated or [SIZE_SHARE * own]:
            if size in tested:
                continue
            share = min(size / own, 1.0)
            smaller = load * (share if source.imposed == "displacement_m" else share**2)  # forces go with the area
            changed = with_length(source, table, key, size / own)
            once = [(ramp_s, smaller), (ramp_s, 0.0)]
            if table == "specimen" and source.tool is not None and source.tool.shape == "platen":
                cycles = [(ramp_s, 0.0), *(MANY_CYCLES * once)]
                yield f"rest, then {MANY_CYCLES} cycles of {what.format(size)}", _course(changed, cycles)
            else:
                yield what.format(size), _course(changed, once)


def _with(curve: Curve, **conditions: str) -> Curve:
    return replace(curve, conditions={**curve.conditions, **conditions})


def _load(curve: Curve) -> float:
    return float(distance_from_rest(curve, programme_of(curve)).max())


def _ramp(curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    """Times (k,) s and programme (k,) up to the largest load."""
    top = max(int(np.argmax(distance_from_rest(curve, programme_of(curve)))), 1)
    return curve.time_s[: top + 1], programme_of(curve)[: top + 1]


def _course(source: Curve, pieces: list[tuple[float, float]]) -> Curve:
    """A curve from rest through pieces (duration, distance from rest at its end), in the direction of its source.

    What it would measure is not known: the column is that of the source, by its own programme.
    """
    zero, own = rest_of(source), programme_of(source)
    sign = 1.0 if own[np.argmax(np.abs(own - zero))] >= zero else -1.0
    times, loads = [np.zeros(1)], [np.zeros(1)]
    for duration, load in pieces:
        begin, share = loads[-1][-1], np.arange(1, PIECE_ROWS + 1) / PIECE_ROWS
        if load == begin:
            share = np.geomspace(FIRST_HOLD_SHARE, 1.0, PIECE_ROWS)
        times.append(times[-1][-1] + share * duration)
        loads.append(begin + (load - begin) * share)
    distance = np.concatenate(loads)
    ramp_x, ramp_y = np.abs(_ramp(source)[1] - zero), source.columns[source.predicted][: len(_ramp(source)[0])]
    order = np.argsort(ramp_x)
    columns = {
        source.imposed: zero + sign * distance,
        source.predicted: np.interp(distance, ramp_x[order], ramp_y[order]),
    }
    conditions = {k: v for k, v in source.conditions.items() if k not in CHANGED_CONDITIONS}
    return replace(
        source, time_s=np.concatenate(times), columns={name: columns[name] for name in source.columns}, conditions=conditions
    )
