"""Which test would tell two models apart: the same separation, predicted for tests that were not made."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from explicitfe.close_loop.specimens.series import rest_of
from explicitfe.close_loop.specimens.specimens import Specimens, with_length
from explicitfe.close_loop.statistics.covariance import Covariance, stack
from explicitfe.close_loop.statistics.fingerprints import outside
from explicitfe.close_loop.statistics.refit import BestFit, derivatives
from explicitfe.measured.curve import Curve, programme_of
from explicitfe.results.loop_report import NextExperiment

# The same test is proposed so many times faster and slower: a factor at which relaxation shows.
RATE_FACTOR = 10.0
# A hold is proposed that lasts so many times the test, and the largest strain so many times the one that was reached.
HOLD_FACTOR, STRAIN_FACTOR = 3.0, 1.3
# A tool or a specimen of this share of the size is proposed.
SIZE_SHARE = 0.5
# Rows of a piece that is appended to a programme, and the first of those of a hold, as a share of the hold.
APPENDED_ROWS = 40
FIRST_HOLD_SHARE = 0.01


def proposals(curve: Curve) -> Iterator[tuple[str, Curve]]:
    """Tests like one that was made, each with one thing changed, in words."""
    yield f"the same {RATE_FACTOR:g} times faster", _with_pace(curve, 1.0 / RATE_FACTOR)
    yield f"the same {RATE_FACTOR:g} times slower", _with_pace(curve, RATE_FACTOR)
    yield f"a hold of {_seconds(HOLD_FACTOR * curve.time_s[-1])} at the largest load", _with_hold(curve)
    yield "loading and unloading, then rest", _with_unloading(curve)
    yield "the same twice in a row", _twice(curve)
    if curve.kind != "force-displacement":
        zero = rest_of(curve)
        deeper = zero + STRAIN_FACTOR * (programme_of(curve) - zero)
        yield f"{STRAIN_FACTOR:g} times the strain", _with_programme(curve, curve.time_s, deeper)
    else:
        if curve.tool is not None and curve.tool.radius_mm is not None:
            radius = SIZE_SHARE * curve.tool.radius_mm
            yield (
                f"a tool of {radius:.3g} mm radius, {SIZE_SHARE:g} of the depth",
                _with_smaller_programme(with_length(curve, "tool", "radius_mm", SIZE_SHARE)),
            )
        if curve.specimen is not None and curve.specimen.height_mm is not None:
            height = SIZE_SHARE * curve.specimen.height_mm
            yield (
                f"a specimen {height:.3g} mm high, {SIZE_SHARE:g} of the depth",
                _with_smaller_programme(with_length(curve, "specimen", "height_mm", SIZE_SHARE)),
            )


def next_experiment(
    system: Specimens, one: BestFit, other: BestFit, covariance: Covariance, names: tuple[str, str]
) -> NextExperiment | None:
    """The proposal that separates two models best, if the second one may adapt to it; None if none can be computed."""
    longest = max(range(len(system.curves)), key=lambda k: system.curves[k].time_s[-1])
    source = system.curves[longest]
    noise = covariance.rows[longest]
    best: NextExperiment | None = None
    largest = -np.inf
    for what, curve in proposals(source):
        test = replace(system, curves=(replace(curve, id="proposed"),))
        apart = separation(test, one, other, covariance, float(noise.sd.mean()), noise.effective / len(noise.sd))
        if apart is not None and apart > largest:
            best = NextExperiment(protocol=f"{what} (as {source.id})", separates=list(names), separation=apart)
            largest = apart
    return best


def separation(test: Specimens, one: BestFit, other: BestFit, covariance: Covariance, sd: float, share: float) -> float | None:
    """|y_one - y_other|^2 over the data and a further test, with the parameters of ``other`` at their best to first order.

    Parameters
    ----------
    sd : noise of a row of the further test, SI.
    share : of its rows that are independent.
    """
    first, second = test.answers([one.model, other.model])
    if first is None or second is None:
        return None
    y = stack(second)
    slopes = derivatives(test, other.model, y)
    by = np.sqrt(share) / sd
    gap = np.concatenate([covariance.whiten(one.answer - other.answer), by * (stack(first) - y)])
    J = np.concatenate([other.jacobian, by * slopes])
    return float((outside(J, gap[:, None]) ** 2).sum())


def _with_programme(curve: Curve, time_s: np.ndarray, programme: np.ndarray) -> Curve:
    """A curve with another programme; what it would measure is not known."""
    columns = {curve.imposed: programme, curve.predicted: np.interp(time_s, curve.time_s, curve.columns[curve.predicted])}
    conditions = {k: v for k, v in curve.conditions.items() if k not in ("rate_per_s", "max_strain")}
    return replace(curve, time_s=time_s, columns={name: columns[name] for name in curve.columns}, conditions=conditions)


def _with_pace(curve: Curve, times: float) -> Curve:
    """A curve that lasts so many times as long."""
    return _with_programme(curve, times * curve.time_s, programme_of(curve))


def _with_smaller_programme(curve: Curve) -> Curve:
    """A curve whose programme is as much smaller as a tool or a specimen of the smaller size asks for."""
    share = SIZE_SHARE if curve.imposed == "displacement_m" else SIZE_SHARE**2  # forces go with the area
    return _with_programme(curve, curve.time_s, share * programme_of(curve))


def _until_peak(curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    """Times (k,) s and programme (k,) up to the largest load."""
    top = max(int(np.argmax(np.abs(programme_of(curve) - rest_of(curve)))), 1)
    return curve.time_s[: top + 1], programme_of(curve)[: top + 1]


def _with_hold(curve: Curve) -> Curve:
    """The loading, then a hold at the largest load."""
    t, x = _until_peak(curve)
    hold = t[-1] + np.geomspace(FIRST_HOLD_SHARE, 1.0, APPENDED_ROWS) * HOLD_FACTOR * curve.time_s[-1]
    return _with_programme(curve, np.concatenate([t, hold]), np.concatenate([x, np.full(APPENDED_ROWS, x[-1])]))


def _with_unloading(curve: Curve) -> Curve:
    """The loading, unloading as fast, and as long a time at rest."""
    t, x = _until_peak(curve)
    zero = rest_of(curve)
    back = t[-1] + np.arange(1, APPENDED_ROWS + 1) / APPENDED_ROWS * t[-1]
    after = back[-1] + np.arange(1, APPENDED_ROWS + 1) / APPENDED_ROWS * t[-1]
    programme = np.concatenate([x, np.linspace(x[-1], zero, APPENDED_ROWS + 1)[1:], np.full(APPENDED_ROWS, zero)])
    return _with_programme(curve, np.concatenate([t, back, after]), programme)


def _twice(curve: Curve) -> Curve:
    """Loading, unloading and rest, two times."""
    once = _with_unloading(curve)
    x = programme_of(once)
    gap = once.time_s[-1] - once.time_s[-2]
    times = np.concatenate([once.time_s, once.time_s[-1] + gap + once.time_s])
    return _with_programme(curve, times, np.concatenate([x, x]))


def _seconds(t: float) -> str:
    return f"{t:.3g} s"
