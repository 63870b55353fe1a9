"""Constants with which a fit begins: the elastic law that meets the data best among those that carry the imposed loads.

Without gravity the forces of an elastic law are proportional to its constants: F = C10 Phi(d; C20 / C10) at the depth d of the
tool. One ramp of the depth therefore gives the answers of all sizes of the constants: a multiple of its forces where the
displacement is imposed, and the inverse of Phi where the force is. The ramp ends at the largest measured depth. An imposed force
bounds C10 from below, because a softer body would sink in further than that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from explicitfe.fem.effects import Effect
from explicitfe.inverse.close_loop.specimens.plan import plan_of
from explicitfe.inverse.close_loop.specimens.series import determined
from explicitfe.inverse.measured.curve import Curve, programme_of
from explicitfe.inverse.predict.correction import Job, Run, kind_of, ramp_of
from explicitfe.inverse.predict.experiment import experiments
from explicitfe.inverse.predict.tissue import EVERY, Constants, Tissue
from explicitfe.platform.errors import RunError

# C10 [Pa] of the ramps; any value would do.
RAMP_C10_PA = 200.0
# Ratios of C20 to C10 that are tried.
C20_RATIOS = (0.0, 0.05, 0.2, 0.5, 1.0)
# Where a force is imposed, C10 is sought between the smallest one that carries it and this multiple of it.
LARGEST_SIZE_RATIO, TRIED_SIZES = 100.0, 200
# Every second row of a usual ramp does to begin with, with a cubic between them that is read at so many places.
ROWS_STRIDE, TRIED_PLACES = 2, 129
# A ramp that does not reach the largest measured depth is repeated to these shares of it. Where the force is imposed, a stiffer
# body carries it at a smaller depth.
DEPTH_SHARES = (1.0, 0.5, 0.25)
# Constants with which a test by force cannot be computed are multiplied by this factor, so often at most.
STIFFER_FACTOR, MOST_STIFFER = 1.5, 4


@dataclass(frozen=True)
class Baseline:
    """How the elastic tests of some curves are computed.

    Attributes
    ----------
    elastic : the tissue; its constants are replaced.
    known : effects that the dataset states.
    homogeneous : all tests are homogeneous states.
    run : computes tests.
    """

    elastic: Tissue
    known: tuple[Effect, ...]
    homogeneous: bool
    run: Callable[[list[Job]], list[Run]]

    def tissue(self, C10_Pa: float, C20_Pa: float) -> Tissue:
        """The elastic tissue with other constants."""
        return self.elastic.model_copy(update={"constants": {EVERY: Constants(C10_Pa=C10_Pa, C20_Pa=C20_Pa)}})


def first_constants(curves: Sequence[Curve], baseline: Baseline) -> tuple[float, float]:
    """C10 and C20 [Pa] with which the fit of some curves begins.

    Parameters
    ----------
    curves : that share the constants.

    Raises
    ------
    RunError : none of them can be computed with any constants; the reason of the first one.
    """
    responses = _responses(curves, baseline)
    most = max(sum(not isinstance(r, str) for r in row) for row in responses.values())
    if not most:
        raise RunError(f"no curve can be computed with an elastic law: {responses[C20_RATIOS[0]][0]}")
    usable = {q: [r for r in row if not isinstance(r, str)] for q, row in responses.items()}
    _, size, q = min((*_best_size(row), q) for q, row in usable.items() if len(row) == most)
    if not np.isfinite(size):
        raise RunError("no positive C10 meets the measured forces; check the signs of the columns.")
    return _carrying(curves, baseline, size * RAMP_C10_PA, q)


def _carrying(curves: Sequence[Curve], baseline: Baseline, C10_Pa: float, q: float) -> tuple[float, float]:
    """The constants, or stiffer ones where a test by force cannot be computed with them."""
    by_force = [test for test in experiments(curves) if test[0].imposed == "force_N"]
    for factor in STIFFER_FACTOR ** np.arange(MOST_STIFFER):
        stiffer = float(factor) * C10_Pa
        tissue = baseline.tissue(stiffer, q * stiffer)
        for effect in baseline.known:
            tissue = tissue.with_effect(effect)
        answers = baseline.run([plan_of(tissue, test, curves, baseline.homogeneous).job for test in by_force])
        if not any(isinstance(answer, str) for answer in answers):
            return stiffer, q * stiffer
    return C10_Pa, q * C10_Pa  # softness is not the reason


# ---- answers of constants of one ratio and any size ----


@dataclass(frozen=True)
class _Scaled:
    """The answer (k,) SI to an imposed displacement, proportional to the size of the constants."""

    answer: np.ndarray
    measured: np.ndarray

    def at(self, size: float) -> np.ndarray:
        return size * self.answer


@dataclass(frozen=True)
class _Inverted:
    """The depth (k,) SI at an imposed force, by the ramp (m,) of the size 1."""

    depth_m: np.ndarray
    ramp_N: np.ndarray
    force_N: np.ndarray
    measured: np.ndarray

    @property
    def smallest_size(self) -> float:
        """Softer constants do not carry the largest force at the depths of the ramp."""
        return float(np.abs(self.force_N).max() / self.ramp_N[-1])

    def at(self, size: float) -> np.ndarray:
        # An untied tool has no rows of negative force; a small pull of a tied one is about the opposite of a push.
        return np.sign(self.force_N) * np.interp(np.abs(self.force_N) / size, self.ramp_N, self.depth_m)


_Response = _Scaled | _Inverted
_Ramp = tuple[np.ndarray, np.ndarray]  # depth [m] and force [N] of RAMP_C10_PA, (m,) increasing


def _best_size(responses: Sequence[_Response]) -> tuple[float, float]:
    """The smallest error, a sum of relative squares, and the size of the constants that has it; infinite if there is none."""
    inverted = [r.smallest_size for r in responses if isinstance(r, _Inverted)]

    def error(size: float) -> float:
        return sum(float(np.sum((r.at(size) - r.measured) ** 2) / max(r.measured @ r.measured, 1e-300)) for r in responses)

    if inverted:
        sizes = max(inverted) * np.geomspace(1.0, LARGEST_SIZE_RATIO, TRIED_SIZES)
        return min((error(size), float(size)) for size in sizes)
    weights = [1.0 / max(float(r.measured @ r.measured), 1e-300) for r in responses]
    top = sum(w * float(r.at(1.0) @ r.measured) for w, r in zip(weights, responses, strict=True))
    bottom = sum(w * float(r.at(1.0) @ r.at(1.0)) for w, r in zip(weights, responses, strict=True))
    size = top / bottom if bottom > 0.0 else 0.0
    return (error(size), size) if size > 0.0 else (np.inf, np.inf)


def _responses(curves: Sequence[Curve], baseline: Baseline) -> dict[float, list[_Response | str]]:
    """Ratio -> what constants of it answer to each curve, or why they cannot."""
    tissues = {q: baseline.tissue(RAMP_C10_PA, q * RAMP_C10_PA) for q in C20_RATIOS}
    if not baseline.homogeneous:
        ramps = _ramps(curves, tissues, baseline)
        return {q: [_read(curve, ramps[q, kind_of(curve)]) for curve in curves] for q in C20_RATIOS}
    by_curve: dict[tuple[float, str], _Response | str] = {}
    jobs = [(q, test) for q in C20_RATIOS for test in experiments(curves)]
    for (q, test), run in zip(jobs, baseline.run([(test, tissues[q]) for q, test in jobs]), strict=True):
        for number, curve in enumerate(test):
            by_curve[q, curve.id] = run if isinstance(run, str) else _Scaled(run[number], curve.columns[curve.predicted])
    return {q: [by_curve[q, curve.id] for curve in curves] for q in C20_RATIOS}


def _ramps(curves: Sequence[Curve], tissues: Mapping[float, Tissue], baseline: Baseline) -> dict[tuple[float, str], _Ramp | str]:
    """Ratio and kind of test -> depth and force of a ramp, or why there is none."""
    kinds: dict[str, list[Curve]] = {}
    for curve in curves:
        kinds.setdefault(kind_of(curve), []).append(curve)
    done: dict[tuple[float, str], _Ramp | str] = {}
    todo = [(q, kind) for q in tissues for kind in kinds]
    for share in DEPTH_SHARES:
        ramps = [_ramp(kinds[kind], share) for _, kind in todo]
        runs = baseline.run([((ramp,), tissues[q]) for ramp, (q, _) in zip(ramps, todo, strict=True)])
        for key, ramp, run in zip(todo, ramps, runs, strict=True):
            if not isinstance(run, str):
                last = int(np.argmax(run[0])) + 1  # a force above the largest one is not carried
                depth_m = np.linspace(0.0, ramp.displacement_m[last - 1], TRIED_PLACES)
                force_N = np.zeros(TRIED_PLACES)
                if last > 1:
                    force_N = PchipInterpolator(ramp.displacement_m[:last], run[0][:last])(depth_m)
                done[key] = depth_m, np.maximum.accumulate(force_N)
            else:
                done.setdefault(key, run)
        todo = [key for key in todo if isinstance(done[key], str) and kinds[key[1]][0].imposed == "force_N"]
    return done


def _ramp(alike: Sequence[Curve], share: float) -> Curve:
    """A ramp of the displacement to a share of the largest one of some tests."""
    driven = []
    for curve in alike:
        assert curve.tool is not None
        driven.append(replace(curve, tool=curve.tool.model_copy(update={"control": "displacement"})))
    ramp = ramp_of(driven[0], driven, (), rounded=False)
    few = slice(None, None, ROWS_STRIDE)
    columns = {name: values[few] for name, values in ramp.columns.items()}
    return replace(ramp, time_s=ramp.time_s[few], columns=columns | {"displacement_m": share * columns["displacement_m"]})


def _read(curve: Curve, ramp: _Ramp | str) -> _Response | str:
    """What is read off a ramp for the rows of a curve that a model can answer."""
    if isinstance(ramp, str):
        return ramp
    depth_m, force_N = ramp
    if not force_N[-1] > 0.0:
        return f'curve "{curve.id}": the tool meets no resistance; check the sign of the displacement.'
    rows = determined(curve)
    programme, measured = programme_of(curve)[rows], curve.columns[curve.predicted][rows]
    if curve.imposed == "force_N":
        return _Inverted(depth_m, force_N, programme, measured)
    # A bonded tool can pull; a small pull is about the opposite of a push.
    pulls = curve.tool is not None and curve.tool.shape == "bonded-disc"
    sign = np.sign(programme) if pulls else (programme > 0.0).astype(float)
    return _Scaled(sign * np.interp(np.abs(programme), depth_m, force_N), measured)
