"""Which test would tell two models apart: the same separation, predicted for tests that were not made."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from explicitfe.close_loop.specimens.specimens import Specimens, scaled
from explicitfe.close_loop.statistics.covariance import Covariance, stacked
from explicitfe.close_loop.statistics.fingerprints import outside
from explicitfe.close_loop.statistics.refit import Fitted, derivatives
from explicitfe.measured.curve import Curve, programme_of

FASTER, WAIT, ROWS = 10.0, 3.0, 40  # times; times the duration; rows of what is appended
SMALLER, DEEPER = 0.5, 1.3


def proposals(curve: Curve) -> Iterator[tuple[str, Curve]]:
    """Tests like one that was made, each with one thing changed, in words."""
    yield f"the same {FASTER:g} times faster", _timed(curve, 1.0 / FASTER)
    yield f"the same {FASTER:g} times slower", _timed(curve, FASTER)
    yield f"a hold of {_seconds(WAIT * curve.time_s[-1])} at the largest load", _held(curve)
    yield "loading and unloading, then rest", _unloaded(curve)
    yield "the same twice in a row", _twice(curve)
    if curve.kind != "force-displacement":
        rest = 1.0 if curve.imposed == "stretch" else 0.0
        yield f"{DEEPER:g} times the strain", _imposed(curve, curve.time_s, rest + DEEPER * (programme_of(curve) - rest))
    else:
        if curve.tool is not None and curve.tool.radius_mm is not None:
            radius = SMALLER * curve.tool.radius_mm
            yield (
                f"a tool of {radius:.3g} mm radius, {SMALLER:g} of the depth",
                _scaled_way(scaled(curve, "tool", "radius_mm", SMALLER)),
            )
        if curve.specimen is not None and curve.specimen.height_mm is not None:
            height = SMALLER * curve.specimen.height_mm
            yield (
                f"a specimen {height:.3g} mm high, {SMALLER:g} of the depth",
                _scaled_way(scaled(curve, "specimen", "height_mm", SMALLER)),
            )


def next_experiment(
    system: Specimens, one: Fitted, other: Fitted, covariance: Covariance, names: tuple[str, str]
) -> dict[str, Any] | None:
    """The proposal that separates two models best, the second one free to adapt to it; None if none can be computed."""
    longest = max(range(len(system.curves)), key=lambda k: system.curves[k].time_s[-1])
    source = system.curves[longest]
    noise = covariance.rows[longest]
    best: dict[str, Any] | None = None
    for what, curve in proposals(source):
        test = replace(system, curves=(replace(curve, id="proposed"),))
        apart = separation(test, one, other, covariance, float(noise.sd.mean()), noise.effective / len(noise.sd))
        if apart is not None and (best is None or apart > best["separation"]):
            best = {"protocol": f"{what} (as {source.id})", "separates": list(names), "separation": apart}
    return best


def separation(test: Specimens, one: Fitted, other: Fitted, covariance: Covariance, sd: float, share: float) -> float | None:
    """|y_one - y_other|^2 over the data and one test more, with the parameters of ``other`` at their best to first order.

    ``sd`` of a row of the new test, ``share`` of its rows that are independent.
    """
    first, second = test.answers([one.model, other.model])
    if first is None or second is None:
        return None
    y = stacked(second)
    slopes = derivatives(test, other.model, y)
    by = np.sqrt(share) / sd
    gap = np.concatenate([covariance.whiten(one.answer - other.answer), by * (stacked(first) - y)])
    J = np.concatenate([other.jacobian, by * slopes])
    rest = outside(J, gap[:, None])
    return float((rest**2).sum())


def _imposed(curve: Curve, time_s: np.ndarray, way: np.ndarray) -> Curve:
    """A curve with another programme; what it measures is not known."""
    columns = {curve.imposed: way, curve.predicted: np.interp(time_s, curve.time_s, curve.columns[curve.predicted])}
    conditions = {k: v for k, v in curve.conditions.items() if k not in ("rate_per_s", "max_strain")}
    return replace(curve, time_s=time_s, columns={name: columns[name] for name in curve.columns}, conditions=conditions)


def _timed(curve: Curve, times: float) -> Curve:
    return _imposed(curve, times * curve.time_s, programme_of(curve))


def _scaled_way(curve: Curve) -> Curve:
    way = SMALLER if curve.imposed == "displacement_m" else SMALLER**2  # forces go with the area
    return _imposed(curve, curve.time_s, way * programme_of(curve))


def _peak(curve: Curve) -> int:
    rest = 1.0 if curve.imposed == "stretch" else 0.0
    return max(int(np.argmax(np.abs(programme_of(curve) - rest))), 1)


def _held(curve: Curve) -> Curve:
    top = _peak(curve)
    t, x = curve.time_s[: top + 1], programme_of(curve)[: top + 1]
    more = t[-1] + np.geomspace(0.01, 1.0, ROWS) * WAIT * curve.time_s[-1]
    return _imposed(curve, np.concatenate([t, more]), np.concatenate([x, np.full(ROWS, x[-1])]))


def _unloaded(curve: Curve) -> Curve:
    top = _peak(curve)
    t, x = curve.time_s[: top + 1], programme_of(curve)[: top + 1]
    rest = 1.0 if curve.imposed == "stretch" else 0.0
    back = t[-1] + np.arange(1, ROWS + 1) / ROWS * t[-1]
    after = back[-1] + np.arange(1, ROWS + 1) / ROWS * t[-1]
    way = np.concatenate([x, np.linspace(x[-1], rest, ROWS + 1)[1:], np.full(ROWS, rest)])
    return _imposed(curve, np.concatenate([t, back, after]), way)


def _twice(curve: Curve) -> Curve:
    way = _unloaded(curve)
    x = programme_of(way)
    gap = way.time_s[-1] - way.time_s[-2]
    return _imposed(curve, np.concatenate([way.time_s, way.time_s[-1] + gap + way.time_s]), np.concatenate([x, x]))


def _seconds(t: float) -> str:
    return f"{t:.3g} s"
