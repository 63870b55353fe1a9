"""Formants of a tube: its free vibrations with the glottis closed.

A tube is a row of cylinders from the glottis to the mouth. A cylinder's chain matrix gives pressure and flow at its near end from
those at its far end (M. M. Sondhi, J. Schroeter 1987); the product of all is that of the tube.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from explicitfe.platform.errors import InputError
from explicitfe.results.acoustics.losses import (
    ALL_LOSSES,
    CLOSED_TRACT_FREQUENCY_RAD_S,
    LOSSLESS,
    Losses,
    radiation_impedance,
    series_impedance,
    shunt_admittance,
)

# Free vibrations without loss are looked for between these frequencies, in steps that no two of them share.
HIGHEST_FREQUENCY_HZ = 8000.0
FREQUENCY_STEP_HZ = 5.0
# Newton's method ends when a step is smaller than this share of the frequency, or after so many.
NEWTON_SHARE = 1e-10
NEWTON_STEPS_AT_MOST = 60
# For the derivative.
DIFFERENCE_SHARE = 1e-6
# The losses are brought in by as many parts, each time from the formants of the last.
PARTS_OF_LOSS = 4


class Formant(NamedTuple):
    """A free vibration: its frequency and its bandwidth at -3 dB, Hz."""

    frequency_hz: float
    bandwidth_hz: float


class Tube(NamedTuple):
    """Cylinders from the glottis to the mouth: ``lengths`` (k,) m and ``areas`` (k,) m2."""

    lengths: np.ndarray
    areas: np.ndarray


def flow_ratio(s: np.ndarray, tube: Tube, losses: Losses, share: float = 1.0) -> np.ndarray:
    """Flow at the glottis over flow at the mouth, (f,): 0 at a formant; its inverse is the transfer function of the tract.

    Parameters
    ----------
    s : (f,) complex frequencies, rad/s.
    share : of the losses, from 0 to 1.
    """
    mouth = share * radiation_impedance(s, float(tube.areas[-1]), losses)
    return at_the_glottis(s, tube, losses, mouth, np.ones_like(s), share)[1]


def at_the_glottis(
    s: np.ndarray, tube: Tube, losses: Losses, pressure: np.ndarray, flow: np.ndarray, share: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Pressure and flow at the glottis from those at the mouth, all (f,): one cylinder's chain matrix after the other."""
    for length, area in zip(tube.lengths[::-1], tube.areas[::-1], strict=True):
        series = length * _partly(s, float(area), losses, share, series_impedance)
        shunt = length * _partly(s, float(area), losses, share, shunt_admittance)
        phase = np.sqrt(series * shunt)
        cosine = np.cosh(phase)
        # sinh(x) / x, which is even: the sign of the root does not matter
        sine = np.divide(np.sinh(phase), phase, out=np.ones_like(phase), where=phase != 0.0)
        pressure, flow = cosine * pressure + series * sine * flow, shunt * sine * pressure + cosine * flow
    return pressure, flow


def formants(tube: Tube, count: int = 3, losses: Losses = ALL_LOSSES) -> list[Formant]:
    """The lowest formants of a tube whose end at the glottis is closed.

    Without loss they are the frequencies at which the flow ratio, then real, changes its sign. From these Newton's method goes to
    the complex frequencies with losses; the imaginary part is the frequency, minus the real part over pi the bandwidth.

    Raises
    ------
    InputError : a section or the mouth is closed, or there are fewer formants below 8 kHz.
    """
    if not (tube.areas > 0.0).all() or not (tube.lengths > 0.0).all():
        raise InputError("a tube with a section of no area or no length has no formants.")
    omega = 2.0 * np.pi * np.arange(0.0, HIGHEST_FREQUENCY_HZ, FREQUENCY_STEP_HZ)
    ratio = flow_ratio(1j * omega, tube, losses, 0.0).real
    after = 1 + np.flatnonzero((ratio[:-1] > 0.0) != (ratio[1:] > 0.0))[:count]  # a zero on the grid counts once
    if len(after) < count:
        raise InputError(f"this tube has {len(after)} formants below {HIGHEST_FREQUENCY_HZ:g} Hz, not {count}.")
    before = after - 1
    start = omega[before] + (omega[after] - omega[before]) * ratio[before] / (ratio[before] - ratio[after])
    s = _newton(1j * start, tube, losses, 0.0)
    for part in range(1, PARTS_OF_LOSS + 1):
        if losses.walls:  # they raise a formant, the more the lower it is
            s = s.real + 1j * np.sqrt(s.imag**2 + CLOSED_TRACT_FREQUENCY_RAD_S**2 / PARTS_OF_LOSS)
        s = _newton(s, tube, losses, part / PARTS_OF_LOSS)
    return [Formant(float(each.imag) / (2.0 * np.pi), -float(each.real) / np.pi) for each in s]


def _newton(s: np.ndarray, tube: Tube, losses: Losses, share: float) -> np.ndarray:
    """Zeros of the flow ratio (k,) near s (k,)."""
    for _ in range(NEWTON_STEPS_AT_MOST):
        apart = DIFFERENCE_SHARE * np.abs(s)
        low, at, high = flow_ratio(np.concatenate([s - apart, s, s + apart]), tube, losses, share).reshape(3, -1)
        step = 2.0 * apart * at / (high - low)
        s = s - step
        if (np.abs(step) < NEWTON_SHARE * np.abs(s)).all():
            return s
    raise InputError("the formants of this tube cannot be computed: Newton's method does not end.")


def _partly(
    s: np.ndarray, area: float, losses: Losses, share: float, of: Callable[[np.ndarray, float, Losses], np.ndarray]
) -> np.ndarray:
    """A quantity of the tube with a share of its losses."""
    without = of(s, area, LOSSLESS)
    return without if share == 0.0 else without + share * (of(s, area, losses) - without)
