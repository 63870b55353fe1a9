"""Fast answers for vibrating curves: features of the motion that change about linearly with the strengths of effects.

The coordinates of a curve are one damped vibration and where they come to rest,

    y(t) = end + Re[A exp((-d + i w) t)],

with one frequency w and decay d for all coordinates of a curve, and a remainder that is a function of the phase w t: further
modes, and a decay that is not exponential. A stronger effect shifts the phase of a vibration without bound, so a change of
samples is no signature of it, and says nothing about another strength. The features log w, d, log A, log end and the remainder at
fixed phases change in proportion to a strength, and effects add up in them. They come from the runs with which the candidates
are screened.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline
from scipy.optimize import least_squares

from explicitfe.inverse.close_loop.statistics.system import Hypothesis, Parameter

# Rows after the start that determine a vibration, and the times that the spectrum is padded for a first frequency.
FEWEST_VIBRATION_ROWS, SPECTRUM_PADDING = 12, 8
# A vibration that is smaller than this share of the largest coordinate of a curve has no phase of its own.
LEAST_PHASE_SHARE = 0.02
# The remainder is known up to a phase that is larger than that of the first curve by this factor: others may be faster. So many
# phases for each row follow the ripples of further modes where others are slower.
PHASES_BEYOND, PHASES_PER_ROW = 1.25, 2


@dataclass(frozen=True, eq=False)
class Vibration:
    """Features of the coordinates of one curve.

    Attributes
    ----------
    rate : (2,) log of the angular frequency [rad/s], and decay [1/s].
    end, amplitude : (c,) m, where each coordinate comes to rest, and its complex amplitude.
    phases : (g,) rad, rising, at which the remainder is known.
    remainder : (g, c) m, what the damped vibration leaves: coefficients of a cubic spline through the phases.
    """

    rate: np.ndarray
    end: np.ndarray
    amplitude: np.ndarray
    phases: np.ndarray
    remainder: np.ndarray

    def wave_at(self, time_s: np.ndarray) -> np.ndarray:
        """Coordinates (k, c) m at times (k,) s since the start, without the remainder."""
        wave = np.exp((-self.rate[1] + 1j * np.exp(self.rate[0])) * time_s)
        return np.asarray(self.end + np.real(wave[:, None] * self.amplitude))

    def at(self, time_s: np.ndarray) -> np.ndarray:
        """Coordinates (k, c) m at times (k,) s since the start, 0 before it."""
        t = np.maximum(time_s, 0.0)
        return np.where(time_s[:, None] > 0.0, self.wave_at(t) + self.beside(np.exp(self.rate[0]) * t), 0.0)

    def beside(self, phase: np.ndarray) -> np.ndarray:
        """Remainder (k, c) m at phases (k,) rad, constant beyond the last one."""
        spline = BSpline.construct_fast(_knots(self.phases), self.remainder, 3)
        return np.asarray(spline(np.minimum(phase, self.phases[-1])))


def vibration_of(time_s: np.ndarray, y: np.ndarray, first: Vibration | None = None) -> Vibration | None:
    """Features of coordinates y (k, c) m at times (k,) s from the start on, by least squares; None if they do not vibrate.

    Frequency and decay are found by the method of variable projection (Golub & Pereyra 1973), from those of a similar curve or
    from the maximum of the spectrum.
    """
    if len(time_s) < FEWEST_VIBRATION_ROWS or not np.ptp(y, axis=0).max() > 0.0:
        return None
    size = np.ptp(y, axis=0).max()

    def parts(rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        wave = np.exp((-rate[1] + 1j * np.exp(rate[0])) * time_s)
        columns = np.column_stack([np.ones(len(time_s)), wave.real, -wave.imag])
        return columns, np.linalg.lstsq(columns, y, rcond=None)[0]

    def left(rate: np.ndarray) -> np.ndarray:
        columns, weights = parts(rate)
        return np.asarray((columns @ weights - y).ravel() / size)

    starts = [_strongest(time_s, y)]
    if first is not None:
        starts.append(first.rate)
    low, high = np.log(np.pi / np.ptp(time_s)) - 1.0, np.log(np.pi / np.diff(time_s).max())
    bounds = ([low, -2.0 / np.ptp(time_s)], [high, 0.5 * np.exp(high)])
    fits = [least_squares(left, np.clip(start, *bounds), bounds=bounds) for start in starts]
    best = min(fits, key=lambda one: float(one.cost))
    weights = parts(best.x)[1]
    frequency = np.exp(best.x[0])
    phases = (
        first.phases
        if first is not None
        else np.linspace(0.0, PHASES_BEYOND * frequency * time_s[-1], round(PHASES_BEYOND * PHASES_PER_ROW * len(time_s)))
    )
    bare = Vibration(best.x, weights[0], weights[1] + 1j * weights[2], phases, np.zeros((len(phases), y.shape[1])))
    before = bare.remainder if first is None else first.beside(phases)
    known = CubicSpline(time_s, y - bare.wave_at(time_s), axis=0)
    # beyond the end of the curve the change stays as it is there
    last = np.minimum(phases, frequency * time_s[-1])
    end = bare.remainder[0] if first is None else first.beside(last[-1:])[0]
    remainder = np.where((phases <= last)[:, None], known(last / frequency), before + known(time_s[-1]) - end)
    return replace(bare, remainder=make_interp_spline(phases, remainder, t=_knots(phases)).c)


def _knots(phases: np.ndarray) -> np.ndarray:
    """Knots of a cubic spline through phases, which is not a knot next to its ends."""
    return np.concatenate([np.repeat(phases[0], 4), phases[2:-2], np.repeat(phases[-1], 4)])


def _strongest(time_s: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Log of the angular frequency of the strongest vibration, and a decay to begin with."""
    most = y[:, int(np.argmax(np.ptp(y, axis=0)))]
    step = float(np.ptp(time_s)) / (len(time_s) - 1)
    even = np.interp(time_s[0] + step * np.arange(len(time_s)), time_s, most)
    spectrum = np.abs(np.fft.rfft((even - even.mean()) * np.hanning(len(even)), SPECTRUM_PADDING * len(even)))
    spectrum[: SPECTRUM_PADDING // 2] = 0.0
    strongest = max(int(np.argmax(spectrum)), 1)
    return np.array([np.log(2.0 * np.pi * strongest / (SPECTRUM_PADDING * len(even) * step)), 2.0 / np.ptp(time_s)])


def change_of(before: Vibration, after: Vibration, size: float) -> np.ndarray:
    """Change (2 + 4 c + g c,) of the features: rates, ends, amplitudes and remainders.

    Ends and amplitudes have logarithms of their ratios, because effects multiply in them, and differences of those that are small
    compared with the largest coordinate ``size`` or change their sign.
    """
    ends = _log_ratios(before.end, after.end, size)
    amplitudes = _log_ratios(before.amplitude, after.amplitude, size)
    left = (after.remainder - before.remainder).ravel()
    return np.concatenate([after.rate - before.rate, *ends, *amplitudes, left])


def _log_ratios(before: np.ndarray, after: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Logarithms (c,) of the ratios of two features, and differences (c,) where a feature is small or its sign changes."""
    small = np.minimum(np.abs(before), np.abs(after)) < LEAST_PHASE_SHARE * size
    small |= np.isrealobj(before) & (np.real(before) * np.real(after) < 0.0)
    ratio = np.where(small, 1.0, after) / np.where(small, 1.0, before)
    return np.where(small, 0.0, np.log(ratio)), np.where(small, after - before, 0.0)


def add_change(before: Vibration, change: np.ndarray) -> Vibration:
    """Features with a change of :func:`change_of`."""
    count = len(before.end)
    end, end_more, log, more = (change[2 + k * count : 2 + (k + 1) * count] for k in range(4))
    return Vibration(
        before.rate + change[:2].real,
        before.end * np.exp(end.real) + end_more.real,
        before.amplitude * np.exp(log) + more,
        before.phases,
        before.remainder + change[2 + 4 * count :].real.reshape(before.remainder.shape),
    )


@dataclass(frozen=True, eq=False)
class Responses:
    """What a term does to the features of each curve.

    Attributes
    ----------
    coordinates : (m, p) of its trials, the strength first, relative to none.
    changes : curve -> (m, f).
    """

    coordinates: np.ndarray
    changes: Mapping[str, np.ndarray]

    def at(self, curve: str, x: np.ndarray) -> np.ndarray:
        """Change (f,) of the features of a curve at coordinates (p,) of the parameters, relative to none.

        Without further parameters it is linear between the trials of the same sign, and beyond the last one; with them it is
        proportional to the strength, by the trials of the same sign and of the nearest shapes.
        """
        changes = self.changes[curve]
        same = self.coordinates[:, 0] * x[0] >= 0.0
        trials = np.flatnonzero(same) if same.any() else np.arange(len(self.coordinates))
        shapes = self.coordinates[trials, 1:]
        if not shapes.shape[1]:
            return self._between(changes, trials[np.argsort(np.abs(self.coordinates[trials, 0]))], float(x[0]))
        order = np.argsort(np.linalg.norm(shapes - x[1:], axis=1))[:2]
        near = trials[order]
        distance = np.linalg.norm(shapes[order] - x[1:], axis=1)
        weight = distance[::-1] / max(float(distance.sum()), 1e-300) if len(near) > 1 else np.ones(1)
        return np.asarray((x[0] * weight / self.coordinates[near, 0]) @ changes[near])

    def _between(self, changes: np.ndarray, trials: np.ndarray, strength: float) -> np.ndarray:
        """Change at a strength, linear between none and trials of rising strength, and as between the last two beyond them."""
        known = np.abs(self.coordinates[trials, 0])
        size = abs(strength) if strength * self.coordinates[trials[0], 0] >= 0.0 else -abs(strength)
        last = min(int(np.searchsorted(known, size)), len(trials) - 1)
        low, below = (0.0, np.zeros_like(changes[0])) if last == 0 else (known[last - 1], changes[trials[last - 1]])
        return np.asarray(below + (size - low) / (known[last] - low) * (changes[trials[last]] - below))


@dataclass(frozen=True, eq=False)
class Emulator:
    """Fast answers near a model.

    Attributes
    ----------
    centre : the model, with the features of each curve there.
    features : curve -> features at the centre.
    responses : effect, or name of a parameter of the baseline -> what it does.
    """

    centre: Hypothesis
    features: Mapping[str, Vibration]
    responses: Mapping[str, Responses]

    def of(self, model: Hypothesis, curve: str) -> Vibration:
        """Features of a curve by a model whose effects are all known."""
        before = self.features[curve]
        total = np.zeros(2 + 4 * len(before.end) + before.remainder.size, dtype=complex)
        for number, parameter in enumerate(self.centre.base):
            if parameter.name in self.responses:
                total += self.responses[parameter.name].at(curve, np.array([model.x[number] - self.centre.x[number]]))
        place = len(model.base)
        for term in model.terms:
            count = len(term.parameters)
            total += self.responses[term.effect].at(curve, relative(term.parameters, model.x[place : place + count]))
            place += count
        return add_change(before, total)


def relative(parameters: Sequence[Parameter], x: np.ndarray) -> np.ndarray:
    """Coordinates (p,) of a term, the strength relative to none."""
    sought = parameters[0].sought
    return np.concatenate([[x[0] - sought.coordinate(sought.none)], x[1:]])
