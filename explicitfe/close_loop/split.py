"""Which curves are fitted and which are held out, by the command line, the dataset, or a rule that is printed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from explicitfe.errors import InputError, nearest
from explicitfe.measured.curve import Curve, Dataset, programme_of, same_measurement
from explicitfe.predict.experiment import experiments

SHARE = 1.0 / 3.0  # of the tests that is held out where there is a choice
MOST_UNDER_A_TOOL = 6  # fitted curves that each cost seconds
DIGITS = 2  # numbers of a programme that agree so far are equal


@dataclass(frozen=True)
class Split:
    """Curves in the order of the file.

    Attributes
    ----------
    left_out : curve -> why it is neither fitted nor held out.
    rule : how the choice was made, in words.
    """

    fit: tuple[Curve, ...]
    holdout: tuple[Curve, ...]
    left_out: dict[str, str]
    rule: str


def split(dataset: Dataset, holdout: Sequence[str] = ()) -> Split:
    """Fitted and held-out curves.

    Raises
    ------
    InputError : a curve to be held out that is not there, or nothing left to fit some constants.
    """
    left_out = {c.id: f"defect: {c.defect}" for c in dataset.curves if c.defect}
    usable: list[Curve] = []
    for curve in dataset.curves:
        twin = next((c for c in usable if same_measurement(c, curve)), None)
        if curve.id in left_out:
            continue
        if twin is not None:
            left_out[curve.id] = f'a second digitisation of "{twin.id}"'
            continue
        usable.append(curve)
    known = [c.id for c in dataset.curves]
    for name in holdout:
        if name not in known:
            raise InputError(f"{dataset.path}: --holdout {name}: there is no such curve; {nearest(name, known)}")
        if name in left_out:
            raise InputError(f"{dataset.path}: --holdout {name}: this curve is left out ({left_out[name]}).")
    if holdout:
        held, rule = set(holdout), "the curves named by --holdout are held out"
    elif any(c.split is not None for c in usable):
        held, rule = {c.id for c in usable if c.split == "holdout"}, "as the dataset says"
    elif dataset.test == "trajectory":
        count = round(SHARE * len(usable)) if len(usable) > 2 else 0
        held, rule = (
            {c.id for c in usable[len(usable) - count :]},
            "the last third of the curves is held out, where there are three",
        )
    else:
        held, rule = _chosen(usable)
    sides = ([c for c in usable if c.id not in held], [c for c in usable if c.id in held])
    fitted = {c.constants for c in sides[0]}
    for curve in sides[1]:
        if curve.constants not in fitted:
            raise InputError(
                f'{dataset.path}: curve "{curve.id}" is held out, and no fit curve shares its constants "{curve.constants}"; '
                "hold out another one."
            )
    if not sides[0]:
        raise InputError(f"{dataset.path}: no curve is left to fit: all are held out or defective.")
    marked = [tuple(replace(c, split=name) for c in side) for side, name in zip(sides, ("fit", "holdout"), strict=True)]
    return Split(*marked, left_out, rule)


def _chosen(curves: Sequence[Curve]) -> tuple[set[str], str]:
    """Curves to hold out: repeats and other specimens first, then conditions between two others."""
    held: set[str] = set()
    families: dict[Any, list[tuple[Curve, ...]]] = {}
    for test in experiments(curves):
        families.setdefault(_family(test[0]), []).append(test)
    for tests in families.values():
        cells: dict[Any, list[tuple[Curve, ...]]] = {}
        for test in tests:
            cells.setdefault(_programme(test[0]), []).append(test)
        wanted = round(SHARE * len(tests))
        out: list[tuple[Curve, ...]] = []
        for repeats in cells.values():
            out += _repeats(repeats)
        between = [cell for cell in _between(list(cells)) if not any(test in out for test in cells[cell])]
        while len(out) < wanted and between:
            out += cells[between.pop(0)]
        held |= {curve.id for test in out for curve in test}
    fitted = [c for c in curves if c.id not in held]
    rule = (
        "of tests that were repeated, about a third (whole specimens where there are several) is held out; then conditions that "
        "lie between two others, until a third of the tests of a kind is held out"
    )
    if len(fitted) > MOST_UNDER_A_TOOL and fitted[0].tool is not None and fitted[0].tool.shape != "platen":
        more = _thinned(fitted)
        held |= more
        rule += f"; no more than about {MOST_UNDER_A_TOOL} curves under a tool are fitted, for time"
    return held, rule


def _repeats(tests: Sequence[tuple[Curve, ...]]) -> list[tuple[Curve, ...]]:
    """Of nominally equal tests those to hold out: the last specimens, else the last repeats."""
    groups = list(dict.fromkeys(test[0].group for test in tests))
    if 1 < len(groups) < len(tests) or (len(groups) == len(tests) > 1):
        last = groups[len(groups) - max(1, round(SHARE * len(groups))) :]
        return [test for test in tests if test[0].group in last]
    count = max(1, round(SHARE * len(tests))) if len(tests) > 1 else 0
    return list(tests[len(tests) - count :])


def _between(cells: Sequence[tuple[float, ...]]) -> list[tuple[float, ...]]:
    """Programmes that lie between two others which differ in one number only; those that are no end of any such line first."""
    inner: dict[tuple[float, ...], tuple[int, int]] = {}
    for cell in cells:
        between = end = 0
        for k in range(len(cell)):
            line = [other[k] for other in cells if other[:k] + other[k + 1 :] == cell[:k] + cell[k + 1 :]]
            if len(set(line)) >= 2:
                between += min(line) < cell[k] < max(line)
                end += cell[k] in (min(line), max(line))
        if between:
            inner[cell] = (end, -between)
    return sorted(inner, key=lambda cell: inner[cell])


def _thinned(fitted: Sequence[Curve]) -> set[str]:
    """Curves to hold out beside, so that few are left: each kind keeps its first, then its most different ones."""
    kept: list[Curve] = []
    kinds: dict[Any, list[Curve]] = {}
    for curve in fitted:
        kinds.setdefault((curve.constants, _family(curve)), []).append(curve)
    queues = [sorted(queue, key=lambda c: _programme(c)) for queue in kinds.values()]
    room = max(MOST_UNDER_A_TOOL, len({c.constants for c in fitted}))
    while queues and len(kept) < room:
        for queue in list(queues):
            if len(kept) < room:
                kept.append(queue.pop(0 if len(queue) % 2 else -1))
            if not queue:
                queues.remove(queue)
    _with_a_repeat(kept, fitted)
    return {c.id for c in fitted} - {c.id for c in kept}


def _with_a_repeat(kept: list[Curve], fitted: Sequence[Curve]) -> None:
    """Put one repeat in for the last of three or more of its kind, if none is there: it tells what equal tests differ by."""

    def alike(one: Curve, other: Curve) -> bool:
        return one is not other and _family(one) == _family(other) and _programme(one) == _programme(other)

    if any(alike(a, b) for a in kept for b in kept):
        return
    for one in kept:
        more = [c for c in kept if c is not one and _family(c) == _family(one)]
        repeat = next((c for c in fitted if c not in kept and alike(c, one)), None)
        if repeat is not None and len(more) >= 2:
            kept[kept.index(more[-1])] = repeat
            return


def _family(curve: Curve) -> Any:
    """What makes tests of another kind: constants, direction, tool, shape and size."""
    size = None if curve.specimen is None or curve.specimen.shape == "point" else round(np.log(curve.specimen.thickness_mm) * 5)
    tool = None if curve.tool is None else (curve.tool.shape, curve.tool.radius_mm)
    return curve.constants, str(curve.conditions.get("direction")), str(curve.conditions.get("material")), tool, size, curve.kind


def _programme(curve: Curve) -> tuple[float, ...]:
    """Numbers of a programme: how far, how fast."""
    way = programme_of(curve)
    rest = 1.0 if curve.imposed == "stretch" else 0.0
    far = float(way[np.argmax(np.abs(way - rest))] - rest)
    moving = np.abs(way - rest) < 0.98 * abs(far)
    first = int(np.argmax(~moving))
    pace = abs(far) / max(float(curve.time_s[first]), 1e-9)
    return _rounded(far), _rounded(pace)


def _rounded(x: float) -> float:
    """To two digits, on a logarithmic scale, so that no limit of rounding lies at a round number."""
    return 0.0 if x == 0.0 else float(np.sign(x) * np.round(np.log(abs(x)) * 8.0))
