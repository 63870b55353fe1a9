"""Which curves are fitted and which are held out, by the command line, the dataset, or a rule that is printed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from explicitfe.inverse.close_loop.thresholds import THRESHOLDS
from explicitfe.inverse.measured.curve import Curve, Dataset, TrajectoryDataset, programme_of, same_measurement
from explicitfe.inverse.predict.experiment import experiments
from explicitfe.platform.errors import InputError, nearest, shortened

# Numbers of a programme are rounded to so many steps per factor of e, that is to about 12 %.
STEPS_PER_LOG = 8.0
# The same for heights of specimens, to about 20 %.
SIZE_STEPS_PER_LOG = 5
# A programme has come to its end where it has covered this share of its way from rest.
FULL_LOAD_SHARE = 0.98
# One repeat may take the place of the last of so many fitted curves of its kind, beside its twin.
CURVES_BESIDE_A_REPEAT = 2

Test = tuple[Curve, ...]  # curves that are measured one after the other
Programme = tuple[float, ...]  # how far and how fast, rounded
Size = tuple[float, ...]  # radius of the tool and height of the specimen, rounded
Family = tuple[object, ...]  # what makes tests of another kind


@dataclass(frozen=True)
class Split:
    """Which curves are fitted and which are held out, in the order of the file.

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
    InputError : a curve to be held out does not exist, or no curve is left to fit some constants to.
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
            raise InputError(f"{dataset.path}: `holdout` {shortened(name)}: there is no such curve; {nearest(name, known)}")
        if name in left_out:
            raise InputError(f"{dataset.path}: `holdout` {name}: this curve is left out ({left_out[name]}).")
    if holdout:
        held, rule = set(holdout), "the curves named by --holdout are held out"
    elif any(c.split is not None for c in usable):
        held, rule = {c.id for c in usable if c.split == "holdout"}, "as the dataset says"
    elif isinstance(dataset, TrajectoryDataset):
        count = round(THRESHOLDS.held_out_share * len(usable)) if len(usable) > 2 else 0
        held, rule = (
            {c.id for c in usable[len(usable) - count :]},
            "the last third of the curves is held out, where there are three",
        )
    else:
        held, rule = _by_rule(usable)
    fitted = tuple(replace(c, split="fit") for c in usable if c.id not in held)
    held_out = tuple(replace(c, split="holdout") for c in usable if c.id in held)
    constants = {c.constants for c in fitted}
    for curve in held_out:
        if curve.constants not in constants:
            raise InputError(
                f'{dataset.path}: curve "{curve.id}" is held out, and no fit curve shares its constants "{curve.constants}"; '
                "hold out another one."
            )
    if not fitted:
        raise InputError(f"{dataset.path}: no curve is left to fit: all are held out or defective.")
    return Split(fitted, held_out, left_out, rule)


def with_added(sides: Split, dataset: Dataset, more: Sequence[Dataset]) -> Split:
    """A split with the curves of further datasets on the side of the fit: they were measured to settle what the first left open.

    Raises
    ------
    InputError : a dataset is of another test, or a name stands twice.
    """
    known = {c.id for c in dataset.curves}
    fitted = list(sides.fit)
    for other in more:
        if other.test != dataset.test or other.curves[0].kind != dataset.curves[0].kind:
            raise InputError(f'{other.path}: this is a test of "{other.test}", and {dataset.path} one of "{dataset.test}".')
        for curve in other.curves:
            if curve.id in known:
                raise InputError(f'{other.path}: a curve "{curve.id}" is in {dataset.path} already; give it another id.')
            known.add(curve.id)
            fitted.append(replace(curve, split="fit"))
    rule = f"{sides.rule}; what was added is fitted" if more else sides.rule
    return replace(sides, fit=tuple(fitted), rule=rule)


def _by_rule(curves: Sequence[Curve]) -> tuple[set[str], str]:
    """Ids of the curves to hold out, and the rule: what differs from all that is fitted; a repeat only where nothing does.

    A repeat is foretold by any model that was fitted to its twin, so it says less of a model than another size or rate.
    """
    held: set[str] = set()
    kinds: dict[Family, dict[Size, list[Test]]] = {}
    for test in experiments(curves):
        kinds.setdefault(_kind(test[0]), {}).setdefault(_size(test[0]), []).append(test)
    for sizes in kinds.values():
        out = _of_inner_sizes(sizes)
        if not out:
            for tests in sizes.values():
                out += _of_inner_programmes(tests)
        held |= {curve.id for test in out for curve in test}
    fitted = [c for c in curves if c.id not in held]
    rule = (
        "about a third of the curves of each kind is held out: first intermediate sizes, then intermediate loading protocols, "
        "then whole specimens, and repeats last"
    )
    most = THRESHOLDS.fitted_curves_under_a_tool
    if len(fitted) > most and fitted[0].tool is not None and fitted[0].tool.shape != "platen":
        held |= _surplus(fitted)
        rule += f"; no more than about {most} curves under a tool are fitted, for time"
    return held, rule


def _of_inner_sizes(sizes: dict[Size, list[Test]]) -> list[Test]:
    """Tests of the sizes that lie between two others, up to a third of all."""
    out: list[Test] = []
    wanted = round(THRESHOLDS.held_out_share * sum(map(len, sizes.values())))
    for size in _between(list(sizes)):
        if len(out) + len(sizes[size]) <= wanted:
            out += sizes[size]
    return out


def _of_inner_programmes(tests: Sequence[Test]) -> list[Test]:
    """Tests of the programmes that lie between two others, up to a third of all; where there are none, repeats."""
    by_programme: dict[Programme, list[Test]] = {}
    for test in tests:
        by_programme.setdefault(_programme(test[0]), []).append(test)
    wanted = round(THRESHOLDS.held_out_share * len(tests))
    out: list[Test] = []
    between = _between(list(by_programme))
    while len(out) < wanted and between:
        out += by_programme[between.pop(0)]
    return out or [test for repeats in by_programme.values() for test in _repeats(repeats)]


def _repeats(tests: Sequence[Test]) -> list[Test]:
    """Of tests with one programme those to hold out: the last specimens, or the last repeats of the only one."""
    groups = list(dict.fromkeys(test[0].group for test in tests))
    if 1 < len(groups) < len(tests) or (len(groups) == len(tests) > 1):
        last = groups[len(groups) - max(1, round(THRESHOLDS.held_out_share * len(groups))) :]
        return [test for test in tests if test[0].group in last]
    count = max(1, round(THRESHOLDS.held_out_share * len(tests))) if len(tests) > 1 else 0
    return list(tests[len(tests) - count :])


def _between(programmes: Sequence[tuple[float, ...]]) -> list[tuple[float, ...]]:
    """Programmes, or sizes, that lie between two others on a line, along which one number changes.

    Those that end no other line come first.
    """
    inner: dict[tuple[float, ...], tuple[int, int]] = {}
    for one in programmes:
        between = end = 0
        for k in range(len(one)):
            line = [other[k] for other in programmes if other[:k] + other[k + 1 :] == one[:k] + one[k + 1 :]]
            if len(set(line)) >= 2:
                between += min(line) < one[k] < max(line)
                end += one[k] in (min(line), max(line))
        if between:
            inner[one] = (end, -between)
    return sorted(inner, key=lambda one: inner[one])


def _surplus(fitted: Sequence[Curve]) -> set[str]:
    """Ids of further curves to hold out, so that few are left: each kind keeps its first, then its most different ones."""
    kept: list[Curve] = []
    kinds: dict[tuple[str, Family], list[Curve]] = {}
    for curve in fitted:
        kinds.setdefault((curve.constants, _family(curve)), []).append(curve)
    queues = [sorted(queue, key=lambda c: _programme(c)) for queue in kinds.values()]
    room = max(THRESHOLDS.fitted_curves_under_a_tool, len({c.constants for c in fitted}))
    while queues and len(kept) < room:
        for queue in list(queues):
            if len(kept) < room:
                kept.append(queue.pop(0 if len(queue) % 2 else -1))
            if not queue:
                queues.remove(queue)
    _keep_a_repeat(kept, fitted)
    return {c.id for c in fitted} - {c.id for c in kept}


def _keep_a_repeat(kept: list[Curve], fitted: Sequence[Curve]) -> None:
    """Keep a repeat in the place of the last curve of its kind, if none is kept: it tells by how much equal tests differ."""

    def alike(one: Curve, other: Curve) -> bool:
        return one is not other and _family(one) == _family(other) and _programme(one) == _programme(other)

    if any(alike(a, b) for a in kept for b in kept):
        return
    for one in kept:
        more = [c for c in kept if c is not one and _family(c) == _family(one)]
        repeat = next((c for c in fitted if c not in kept and alike(c, one)), None)
        if repeat is not None and len(more) >= CURVES_BESIDE_A_REPEAT:
            kept[kept.index(more[-1])] = repeat
            return


def _family(curve: Curve) -> Family:
    return _kind(curve), _size(curve)


def _kind(curve: Curve) -> Family:
    """What makes tests of another kind: constants, direction, material, shape of the tool, columns."""
    tool = None if curve.tool is None else curve.tool.shape
    return curve.constants, str(curve.conditions.get("direction")), str(curve.conditions.get("material")), tool, curve.kind


def _size(curve: Curve) -> Size:
    """Size of the tool and of the specimen; 0 where there is none."""
    specimen, radius_mm = curve.specimen, None if curve.tool is None else curve.tool.radius_mm
    sized = specimen is not None and specimen.shape != "point"
    height = round(np.log(specimen.thickness_mm) * SIZE_STEPS_PER_LOG) if specimen is not None and sized else 0
    return _rounded(radius_mm or 0.0), float(height)


def _programme(curve: Curve) -> Programme:
    moved = programme_of(curve) - (1.0 if curve.imposed == "stretch" else 0.0)
    far = float(moved[np.argmax(np.abs(moved))])
    moving = np.abs(moved) < FULL_LOAD_SHARE * abs(far)
    first = int(np.argmax(~moving))
    pace = abs(far) / max(float(curve.time_s[first]), 1e-9)
    return _rounded(far), _rounded(pace)


def _rounded(x: float) -> float:
    """The logarithm, rounded, so that no limit of rounding lies at a round number."""
    return 0.0 if x == 0.0 else float(np.sign(x) * np.round(np.log(abs(x)) * STEPS_PER_LOG))
