"""Formants of tubes, against closed forms, and against what another program computes for published vocal tracts."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import brentq

from explicitfe.platform.errors import InputError
from explicitfe.results.acoustics import losses as air
from explicitfe.results.acoustics.formants import Tube, at_the_glottis, flow_ratio, formants
from explicitfe.results.acoustics.losses import LOSSLESS, SPEED_OF_SOUND_M_S, Losses

LENGTH_M, AREA_M2 = 0.175, 3e-4
QUARTER_WAVE_HZ = SPEED_OF_SOUND_M_S / (4.0 * LENGTH_M) * np.array([1.0, 3.0, 5.0])
ONLY_VISCOSITY = Losses(heat=False, walls=False, radiation=False)
ONLY_HEAT = Losses(viscosity=False, walls=False, radiation=False)
ONLY_WALLS = Losses(viscosity=False, heat=False, radiation=False)
ONLY_RADIATION = Losses(viscosity=False, heat=False, walls=False)


def tube(*pieces: tuple[float, float], parts: int = 1) -> Tube:
    """Pieces of a length m and an area m2, each cut into parts."""
    lengths, areas = np.repeat(np.array(pieces), parts, axis=0).T
    return Tube(lengths / parts, areas)


def frequencies(of: Tube, losses: Losses, count: int = 3) -> np.ndarray:
    return np.array([formant.frequency_hz for formant in formants(of, count, losses)])


def bandwidths(of: Tube, losses: Losses, count: int = 3) -> np.ndarray:
    return np.array([formant.bandwidth_hz for formant in formants(of, count, losses)])


@pytest.mark.parametrize("parts", [1, 7, 40])
def test_a_uniform_tube_without_loss_has_odd_quarter_waves(parts):
    uniform = tube((LENGTH_M, AREA_M2), parts=parts)
    np.testing.assert_allclose(frequencies(uniform, LOSSLESS), QUARTER_WAVE_HZ, rtol=1e-9)
    np.testing.assert_allclose(bandwidths(uniform, LOSSLESS), 0.0, atol=1e-6)


@pytest.mark.parametrize("losses", [ONLY_VISCOSITY, ONLY_HEAT])
def test_the_boundary_layer_lowers_and_widens_by_its_first_order(losses):
    # s^2 + m s sqrt(s) = -w^2, where m is perimeter / area times the root of a diffusivity: s = i w - m / 2 sqrt(i w) + m^2 / 4,
    # and what is left out is smaller by m / sqrt(w), 0.04 or less.
    diffusivity = {
        ONLY_VISCOSITY: air.AIR_VISCOSITY_PA_S / air.AIR_DENSITY_KG_M3,
        ONLY_HEAT: (air.HEAT_CAPACITY_RATIO - 1.0) ** 2
        * air.HEAT_CONDUCTION_CAL_M_S_K
        / (air.HEAT_CAPACITY_CAL_KG_K * air.AIR_DENSITY_KG_M3),
    }[losses]
    per_root_second = air.perimeter(AREA_M2) / AREA_M2 * np.sqrt(diffusivity)
    lower_hz = per_root_second / 2.0 * np.sqrt(QUARTER_WAVE_HZ * np.pi) / (2.0 * np.pi)
    uniform = tube((LENGTH_M, AREA_M2))
    np.testing.assert_allclose(QUARTER_WAVE_HZ - frequencies(uniform, losses), lower_hz, rtol=2e-3)
    np.testing.assert_allclose(bandwidths(uniform, losses), 2.0 * lower_hz - per_root_second**2 / (4.0 * np.pi), rtol=2e-3)


def test_walls_raise_a_uniform_tube_as_the_polynomial_says():
    # s^2 + w0^2 s^2 / (s^2 + a s + b) = -w^2 is a polynomial of order 4; to first order F^2 = (w^2 + w0^2) / (2 pi)^2.
    closed, a, b = air.CLOSED_TRACT_FREQUENCY_RAD_S, air.WALL_RESISTANCE_OVER_MASS_PER_S, air.WALL_FREQUENCY_RAD_S**2
    uniform = tube((LENGTH_M, AREA_M2))
    for formant, hard_hz in zip(formants(uniform, 3, ONLY_WALLS), QUARTER_WAVE_HZ, strict=True):
        w = 2.0 * np.pi * hard_hz
        roots = np.roots([1.0, a, b + closed**2 + w**2, a * w**2, b * w**2])
        exact = roots[np.argmax(roots.imag)]
        assert formant.frequency_hz == pytest.approx(exact.imag / (2.0 * np.pi), rel=1e-8)
        assert formant.bandwidth_hz == pytest.approx(-exact.real / np.pi, rel=1e-6)
        assert formant.frequency_hz == pytest.approx(np.hypot(hard_hz, closed / (2.0 * np.pi)), rel=5e-3)


def test_a_closing_mouth_leaves_the_resonance_of_air_on_its_walls():
    # Without a way out the air is squeezed as a whole: s^2 + a s + b + w0^2 = 0.
    nearly_closed = tube((LENGTH_M, AREA_M2), (0.01, 1e-10))
    closed, a, b = air.CLOSED_TRACT_FREQUENCY_RAD_S, air.WALL_RESISTANCE_OVER_MASS_PER_S, air.WALL_FREQUENCY_RAD_S**2
    expected_hz = np.sqrt(closed**2 + b - a**2 / 4.0) / (2.0 * np.pi)
    assert frequencies(nearly_closed, ONLY_WALLS, 1)[0] == pytest.approx(expected_hz, rel=0.01)


def test_radiation_lengthens_the_tube_and_widens_the_peak():
    # A narrow tube, so that first order will do: s = c / L (i pi (2 n - 1) / 2 - Z / Z0), where Z is i w times the inertance of
    # 8 / (3 pi) radii of tube, and rho w^2 / (2 pi c).
    area = 1e-5
    narrow, radius = tube((LENGTH_M, area)), np.sqrt(area / np.pi)
    end = 8.0 / (3.0 * np.pi) * radius
    expected_hz = QUARTER_WAVE_HZ * LENGTH_M / (LENGTH_M + end)
    np.testing.assert_allclose(frequencies(narrow, ONLY_RADIATION), expected_hz, rtol=2e-4)
    w = 2.0 * np.pi * expected_hz
    resistance = area * w**2 / (2.0 * np.pi * SPEED_OF_SOUND_M_S**2)
    np.testing.assert_allclose(
        bandwidths(narrow, ONLY_RADIATION), SPEED_OF_SOUND_M_S / (np.pi * LENGTH_M) * resistance, rtol=0.03
    )


@pytest.mark.parametrize(
    "back, front",
    [((0.09, 1e-4), (0.08, 7e-4)), ((0.10, 8e-4), (0.06, 1e-4)), ((0.085, 2e-4), (0.085, 5e-4))],
    ids=["[a]: narrow behind", "[i]: narrow in front", "equal lengths"],
)
def test_two_tubes(back, front):
    """tan(k l1) tan(k l2) = A2 / A1, here without its poles."""

    def mismatch(hz: float) -> float:
        k = 2.0 * np.pi * hz / SPEED_OF_SOUND_M_S
        (l1, a1), (l2, a2) = back, front
        return a1 * np.sin(k * l1) * np.sin(k * l2) - a2 * np.cos(k * l1) * np.cos(k * l2)

    grid = np.arange(1.0, 6000.0, 5.0)
    values = np.array([mismatch(hz) for hz in grid])
    starts = np.flatnonzero(values[:-1] * values[1:] < 0.0)[:4]
    expected = [brentq(mismatch, grid[k], grid[k + 1], xtol=1e-9) for k in starts]
    np.testing.assert_allclose(frequencies(tube(back, front, parts=5), LOSSLESS, 4), expected, rtol=1e-8)


def test_a_bottle_is_a_helmholtz_resonator():
    # k^2 = A / (V l), less a share of k^2 (l1^2 + l2^2) / 3: from tan(x) = x + x^3 / 3 in the equation of two tubes.
    neck, body = (0.02, 2e-6), (0.05, 8e-4)
    k = np.sqrt(neck[1] / (neck[0] * body[0] * body[1]))
    expected_hz = SPEED_OF_SOUND_M_S / (2.0 * np.pi) * k * (1.0 - k**2 * (neck[0] ** 2 + body[0] ** 2) / 6.0)
    assert frequencies(tube(body, neck), LOSSLESS, 1)[0] == pytest.approx(expected_hz, rel=1e-5)


def test_more_sections_of_a_horn_come_nearer_by_the_square():
    # A = A0 exp(2 m x), closed at the narrow end: tan(b L) = -b / m with b^2 = k^2 - m^2.
    m = 8.0

    def mismatch(b: float) -> float:
        return m * np.sin(b * LENGTH_M) + b * np.cos(b * LENGTH_M)

    expected = []
    for number in (1, 2, 3):
        b = brentq(mismatch, (number - 0.5) * np.pi / LENGTH_M, number * np.pi / LENGTH_M)
        expected.append(SPEED_OF_SOUND_M_S / (2.0 * np.pi) * np.hypot(b, m))
    errors = []
    for parts in (20, 40, 80):
        x = (np.arange(parts) + 0.5) * LENGTH_M / parts
        horn = Tube(np.full(parts, LENGTH_M / parts), 1e-4 * np.exp(2.0 * m * x))
        errors.append(np.abs(frequencies(horn, LOSSLESS) / expected - 1.0))
    assert np.all(errors[1] < 1e-3)
    for coarse, fine in pairwise(errors):
        np.testing.assert_allclose(np.log2(coarse / fine), 2.0, atol=0.1)


def test_the_chain_is_reciprocal_and_keeps_or_loses_energy():
    rng = np.random.default_rng(5)
    random = Tube(rng.uniform(0.002, 0.008, 30), rng.uniform(0.2e-4, 8e-4, 30))
    s = 2j * np.pi * np.array([80.0, 440.0, 1700.0, 3900.0])
    one, none = np.ones_like(s), np.zeros_like(s)
    for losses in (LOSSLESS, Losses()):
        (a, c), (b, d) = (at_the_glottis(s, random, losses, *mouth) for mouth in ((one, none), (none, one)))
        np.testing.assert_allclose(a * d - b * c, 1.0, atol=1e-8 * np.abs(a * d).max())
        load = (2.0 + 3.0j) * 1e5 * one
        pressure, flow = at_the_glottis(s, random, losses, load, one)
        power = (pressure * flow.conj()).real
        if losses == LOSSLESS:
            np.testing.assert_allclose(power, load.real, rtol=1e-8)
        else:
            assert np.all(power > load.real)


def test_the_flow_ratio_is_zero_at_a_formant():
    uniform = tube((LENGTH_M, AREA_M2), (0.02, 1e-4))
    for formant in formants(uniform):
        s = np.array([-np.pi * formant.bandwidth_hz + 2j * np.pi * formant.frequency_hz])
        assert abs(flow_ratio(s, uniform, Losses())[0]) < 1e-7


def test_a_closed_tube_has_none():
    with pytest.raises(InputError, match="no area"):
        formants(tube((0.1, 1e-4), (0.01, 0.0)))


# Areas in cm2 from the glottis to the lips, every 5 mm, that Praat has for Russian vowels, after X-ray pictures of one speaker
# (G. Fant 1960, Acoustic Theory of Speech Production): what "Create Vocal Tract from phone" makes.
FANT_CM2 = {
    "a": "1.7 1.2 1.6 3.39 2.1 1.4 1 .8 .8 .8 1 1.4 2.1 2.9 3.09 2.1 2.5 4 5.3 6.16 7 7.6 8.15 8.5 8.6 8.4 8 "
    "7.5 6.9 6 5.1 5 5.5 7.9",
    "e": "2.3 1.95 1.73 1.7 5.3 6.3 6.8 7.55 8.2 9.1 9.7 10.1 10.2 10 8 7.2 7.5 6.4 5.4 4.9 4.35 3.9 3.5 3.1 "
    "2.7 2.4 2.2 2.5 3.4 5 6.7 8.5 10",
    "i": "3 2.9 2.75 2.58 2.7 6.35 7.8 8.9 9.6 10.15 10.55 10.9 11.15 11.3 11.2 10.8 8 7.8 7 4.5 2.8 1.9 1.3 "
    ".9 .65 .55 .5 .55 .7 .95 1.3 2 3 5 8",
    "o": "2.6 2.05 1.56 1.3 5.2 4.54 3.49 2.6 2.1 1.8 1.6 1.4 1.29 1.19 1.22 2.6 2.9 2.2 2.6 3.6 4.55 5.55 6.4 "
    "7.15 8 8.9 9.6 10.5 11.8 14.6 14.5 12.9 10.4 5 3.4 3.4 4",
    "u": "2.5 2.5 2.5 2.4 5 8.1 8.9 8.9 8.4 7.5 5.8 3.9 2.3 1.6 1.2 1.05 1.1 1.4 2.2 2 1.3 2 2.2 2.3 2.8 3.7 5 "
    "6.2 7.9 10.9 12.9 13.15 13 12.5 9.9 3.9 1.8 .32 .4 .6",
}
PRAAT_SPEED_M_S = 353.0
# Peaks of the spectra that Praat 6.1.38 computes of them ("To Spectrum", 20001 frequencies to 5000 Hz, glottis closed), Hz:
# without loss; with the boundary layer, whose heat conduction there has no reactance; with radiation too. Peaks of more than
# 60 Hz are left out: a peak is not a free vibration then.
PRAAT_HZ = {
    "a": ([721.5, 1215.75, 2579.75], [715.75, 1205.0, 2567.5], [669.0, 1146.0]),
    "e": ([447.75, 2100.5, 3071.5], [443.25, 2093.25, 3061.25], [427.75]),
    "i": ([231.0, 2166.25, 3224.0], [224.25, 2159.0, 3212.0], [221.75, 2154.5]),
    "o": ([575.5, 1018.5, 2413.5], [570.0, 1010.25, 2403.75], [525.75, 937.75, 2358.0]),
    "u": ([252.75, 634.0, 2411.0], [244.5, 624.25, 2399.25], [232.25, 615.25, 2397.75]),
}


@pytest.mark.parametrize("vowel", FANT_CM2)
def test_vowels_of_fant_as_praat_computes_them(vowel, monkeypatch):
    monkeypatch.setattr(air, "SPEED_OF_SOUND_M_S", PRAAT_SPEED_M_S)
    areas = 1e-4 * np.array(FANT_CM2[vowel].split(), dtype=float)
    tract = Tube(np.full(len(areas), 5e-3), areas)
    without, layer, radiating = PRAAT_HZ[vowel]
    # The grid of the spectra is 0.25 Hz.
    np.testing.assert_allclose(frequencies(tract, LOSSLESS), without, atol=0.3)
    np.testing.assert_allclose(frequencies(tract, ONLY_VISCOSITY), layer, rtol=2e-3)
    # Its radiation is that of a low frequency, ours also that of a wide mouth.
    both = frequencies(tract, Losses(heat=False, walls=False))
    np.testing.assert_allclose(both[: len(radiating)], radiating, rtol=5e-3)


# F1 to F3, Hz, that Fant calculated himself (table 2.31-1, column BESK, as notes on the book in the public repository ctoth/Qlatt
# repeat it). Those of [u], and F1 and F3 of [i], agree with what Praat computes of its areas. The others do not, by up to 8 %, as
# docs/reference/airway.md shows.
FANT_PRINTED_HZ = {"u": {1: 231.0, 2: 615.0, 3: 2375.0}, "i": {1: 222.0, 3: 3140.0}}


@pytest.mark.parametrize("vowel", FANT_PRINTED_HZ)
def test_vowels_as_fant_printed_them(vowel, monkeypatch):
    monkeypatch.setattr(air, "SPEED_OF_SOUND_M_S", PRAAT_SPEED_M_S)
    areas = 1e-4 * np.array(FANT_CM2[vowel].split(), dtype=float)
    computed = frequencies(Tube(np.full(len(areas), 5e-3), areas), Losses(walls=False))
    for number, printed in FANT_PRINTED_HZ[vowel].items():
        assert computed[number - 1] == pytest.approx(printed, rel=0.01)


# Areas in cm2 of one speaker's vowels, every 3.968 mm, by magnetic resonance imaging (B. H. Story, I. R. Titze, E. A. Hoffman
# 1996, J. Acoust. Soc. Am. 100:537-554), as G. Alzamendi's program getMaleVocalTract_Story1996.m repeats them.
STORY_CM2 = {
    "i": ".33 .3 .36 .34 .68 .5 2.43 3.15 2.66 2.49 3.39 3.8 3.78 4.35 4.5 4.43 4.68 4.52 4.15 4.09 3.51 2.95 2.03 "
    "1.66 1.38 1.05 .6 .35 .32 .12 .1 .16 .25 .24 .38 .28 .36 .65 1.58 2.05 2.01 1.58",
    "a": ".45 .2 .26 .21 .32 .3 .33 1.05 1.12 .85 .63 .39 .26 .28 .23 .32 .29 .28 .4 .66 1.2 1.05 1.62 2.09 2.56 "
    "2.78 2.86 3.02 3.75 4.6 5.09 6.02 6.55 6.29 6.27 5.94 5.28 4.7 3.87 4.13 4.25 4.27 4.69 5.03",
    "u": ".4 .38 .28 .43 .55 1.72 2.91 2.88 2.37 2.1 3.63 5.86 5.63 5.43 4.8 4.56 4.29 3.63 3.37 3.16 3.31 3.22 "
    "2.33 2.07 2.07 1.52 .74 .23 .15 .22 .22 .37 .6 .76 .86 1.82 2.35 2.55 3.73 5.47 4.46 2.39 1.1 .77 .41 .86",
}
STORY_SECTION_M = 3.9682e-3
# F1 to F3, Hz, that a program of J. C. Lucero (2019; after Sondhi and Schroeter 1987) computes of them, with air of 350 m/s and
# 1.14 kg/m3 instead of its own: with walls and a tenth of our radiated power, and with its boundary layer too, which has the same
# strength in tubes of all sizes.
LUCERO_HZ = {
    "i": ([298.99, 2489.41, 3147.13], [291.44, 2463.29, 3120.96]),
    "a": ([795.29, 1134.81, 2763.84], [781.39, 1116.24, 2736.85]),
    "u": ([322.54, 1118.68, 2454.78], [314.61, 1100.98, 2426.96]),
}


@pytest.mark.parametrize("vowel", STORY_CM2)
def test_vowels_of_story_as_another_program_computes_them(vowel):
    areas = 1e-4 * np.array(STORY_CM2[vowel].split(), dtype=float)
    tract = Tube(np.full(len(areas), STORY_SECTION_M), areas)
    hard, lossy = LUCERO_HZ[vowel]
    np.testing.assert_allclose(frequencies(tract, Losses(viscosity=False, heat=False)), hard, rtol=7e-3)
    np.testing.assert_allclose(frequencies(tract, Losses()), lossy, rtol=7e-3)
