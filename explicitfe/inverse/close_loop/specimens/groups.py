"""Whether one set of constants serves all specimens, by nominally equal tests on several of them.

Log of the size of a test = its programme's + its specimen's + the scatter of a test: a two-way analysis of variance (Scheffe
1959, chapter 4). No model of the tissue is asked, and only equal tests are compared, so that an effect of rate, depth or size is
not taken for a difference between specimens. Where specimens differ by more than equal tests do, and by so much that a scatter of
tests would not be a small change of scale any more, each specimen has constants of its own: a random effect of specimens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as fisher
from scipy.stats import t as student

from explicitfe.inverse.close_loop.specimens.series import peers_of
from explicitfe.inverse.close_loop.thresholds import THRESHOLDS
from explicitfe.inverse.measured.curve import Curve, SpecimenDataset
from explicitfe.inverse.predict.experiment import experiments
from explicitfe.results.documents.loop_report import Estimate, GroupedConstant, ReportedGroups, ReportedModel, estimates

# What may name the specimen or the place on it where a curve was measured.
SPECIMEN_KEYS = ("group", "sample", "piece", "site", "spot", "day")
# One set of constants in a hundred datasets is divided by chance.
SIGNIFICANT_P = 0.01
# Sizes of two tests are compared at so many instants.
COMPARED_INSTANTS = 50
# The size of a test is known no better than this share: less is the work of noise.
SIZE_ERROR_SHARE = 0.01


@dataclass(frozen=True)
class Grouping:
    """Constants by specimen.

    Attributes
    ----------
    by : "group", or the condition that names the specimens.
    spread : standard deviation of the log of the specimens' stiffness.
    ratio : largest over smallest stiffness.
    p : that equal specimens differ so much by the scatter of tests; None where each specimen has one test of a programme only.
    """

    by: str
    spread: float
    ratio: float
    p: float | None

    @property
    def text(self) -> str:
        """Why, in a sentence."""
        how = "each was tested once" if self.p is None else f"p = {self.p:.2g}"
        return (
            f"constants are fitted for each {self.by} by itself: in equal tests the stiffness of one is {self.ratio:.2g} times "
            f"that of another ({how})."
        )


def grouping_of(dataset: SpecimenDataset, holdout: Sequence[str] = ()) -> Grouping | None:
    """The grouping of constants that equal tests ask for; None where one set may serve, or where they cannot tell.

    Parameters
    ----------
    holdout : ids of curves that are only predicted; what was measured in them is not looked at.
    """
    curves = [c for c in dataset.curves if not c.defect]
    fitted = [c for c in curves if c.split != "holdout" and c.id not in holdout]
    tried = [
        _grouping(key, curves, fitted) for key in SPECIMEN_KEYS if all(key == "group" or key in c.conditions for c in curves)
    ]
    return max(((gain, g) for gain, g in filter(None, tried)), key=lambda pair: pair[0], default=(0.0, None))[1]


def _grouping(by: str, curves: Sequence[Curve], fitted: Sequence[Curve]) -> tuple[float, Grouping] | None:
    """The gain in BIC, and the grouping; None where it cannot be or is not asked for."""
    names = [_name(c, by) for c in fitted]
    within = {(name, c.constants) for name, c in zip(names, fitted, strict=True)}
    lacking = {_name(c, by) for c in curves} - set(names)
    # Each specimen has constants of its own now, a curve to fit, and stands for one set of constants before.
    if lacking or len(within) != len(set(names)) or len(within) == len({c.constants for c in fitted}):
        return None
    rows = _sizes(by, fitted)
    if len({name for _, name, _ in rows}) < len(within):
        return None
    programmes, specimens = (list(dict.fromkeys(column)) for column in list(zip(*rows, strict=True))[:2])
    y = np.array([size for _, _, size in rows])
    P = np.array([[programme == one for one in programmes] for programme, _, _ in rows], dtype=float)
    G = np.array([[specimen == one for one in specimens] for _, specimen, _ in rows], dtype=float)
    both = np.column_stack([P, G])
    rank, n = int(np.linalg.matrix_rank(both)), len(y)
    apart = len(programmes) + len(specimens) - rank
    if apart != len({constants for _, constants in within}):
        return None  # some specimens share no programme with the others: what differs may be the test
    stiffness = np.linalg.lstsq(both, y, rcond=None)[0][len(programmes) :]
    left, alone = y - both @ np.linalg.pinv(both) @ y, y - P @ np.linalg.pinv(P) @ y
    more, free = rank - len(programmes), n - rank
    squares, squares_alone = float(left @ left), float(alone @ alone)
    least = n * SIZE_ERROR_SHARE**2
    gain = n * np.log(max(squares_alone, least) / max(squares, least)) - more * np.log(n)
    p = None if free == 0 else float(fisher.sf((squares_alone - squares) / more / (max(squares, least) / free), more, free))
    spreads, ratios = [], []
    for constants in {c for _, c in within}:
        own = [stiffness[k] for k, one in enumerate(specimens) if (one, constants) in within]
        spreads.append(float(np.std(own, ddof=1)) if len(own) > 1 else 0.0)
        ratios.append(float(np.exp(max(own) - min(own))))
    grouping = Grouping(by, max(spreads), max(ratios), p)
    significant = p is None or p < SIGNIFICANT_P
    if gain <= 0.0 or not significant or grouping.spread < THRESHOLDS.specimen_spread:
        return None
    return float(gain), grouping


def _sizes(by: str, curves: Sequence[Curve]) -> list[tuple[str, str, float]]:
    """Programme, specimen and log of the size of each test that was done on several specimens."""
    sets: dict[str, list[Curve]] = {}
    for curve in (test[0] for test in experiments(curves)):
        sets.setdefault(peers_of(curve, curves) or curve.id, []).append(curve)
    rows = []
    for programme, peers in sets.items():
        if len({_name(c, by) for c in peers}) < 2:
            continue
        end = min(float(c.time_s[-1]) for c in peers)
        grid = np.linspace(0.0, end, COMPARED_INSTANTS)
        values = np.array([np.interp(grid, c.time_s, c.columns[c.predicted]) for c in peers])
        # Under an imposed force a stiffer specimen moves less.
        sign = -1.0 if peers[0].imposed == "force_N" else 1.0
        mean = values.mean(axis=0)
        scales = values @ mean / float(mean @ mean)
        if scales.min() > 0.0:
            rows += [(programme, _name(c, by), sign * float(np.log(s))) for c, s in zip(peers, scales, strict=True)]
    return rows


def _name(curve: Curve, by: str) -> str:
    return curve.group if by == "group" else str(curve.conditions[by])


def reported_groups(grouping: Grouping, final: ReportedModel) -> ReportedGroups:
    """Mean and spread of each constant over the specimens: geometric, since constants are positive and differ by factors.

    The interval is that of the mean of all such specimens, of which these are a sample (Student's t on the logs): it is what
    another specimen's constants may be compared with, and far wider than that of one specimen.
    """
    values: dict[str, list[float]] = {}
    for (name, _), estimate in estimates(final.parameters).items():
        if name in ("C10_Pa", "C20_Pa") and estimate.value is not None:
            values.setdefault(name, []).append(estimate.value)
    constants = {}
    for name, each in values.items():
        if len(each) < 2 or min(each) <= 0.0:
            continue
        logs = np.log(each)
        half = float(student.ppf(0.975, len(logs) - 1) * np.std(logs, ddof=1) / np.sqrt(len(logs)))
        mean, spread = float(np.mean(logs)), float(np.std(logs, ddof=1))
        ends = [float(np.exp(mean - half)), float(np.exp(mean + half))]
        constants[name] = GroupedConstant(mean=Estimate(value=float(np.exp(mean)), ci95=ends), spread=spread)
    return ReportedGroups(by=grouping.by, p=grouping.p, text=grouping.text, constants=constants)
