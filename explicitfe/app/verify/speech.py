"""Claims on speech: formants of tubes, directions of single muscles, vowels, a closure, and what no tongue goes through."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from explicitfe.app.verify.claim import ClaimFigure, Workshop
from explicitfe.platform.errors import RunError
from explicitfe.results.acoustics.formants import Tube, formants
from explicitfe.results.acoustics.losses import LOSSLESS, SPEED_OF_SOUND_M_S
from explicitfe.results.files import open_result
from explicitfe.results.measure.measure import measure

# Areas in cm2 from the glottis to the lips, every 5 mm, of three Russian vowels after X-ray pictures of one speaker (Fant 1960),
# and the first three peaks [Hz] that Praat 6.1.38 computes from them without losses, on a grid of 0.25 Hz, at its speed of sound.
FANT_CM2 = {
    "a": "1.7 1.2 1.6 3.39 2.1 1.4 1 .8 .8 .8 1 1.4 2.1 2.9 3.09 2.1 2.5 4 5.3 6.16 7 7.6 8.15 8.5 8.6 8.4 8 "
    "7.5 6.9 6 5.1 5 5.5 7.9",
    "i": "3 2.9 2.75 2.58 2.7 6.35 7.8 8.9 9.6 10.15 10.55 10.9 11.15 11.3 11.2 10.8 8 7.8 7 4.5 2.8 1.9 1.3 "
    ".9 .65 .55 .5 .55 .7 .95 1.3 2 3 5 8",
    "u": "2.5 2.5 2.5 2.4 5 8.1 8.9 8.9 8.4 7.5 5.8 3.9 2.3 1.6 1.2 1.05 1.1 1.4 2.2 2 1.3 2 2.2 2.3 2.8 3.7 5 "
    "6.2 7.9 10.9 12.9 13.15 13 12.5 9.9 3.9 1.8 .32 .4 .6",
}
PRAAT_HZ = {"a": (721.5, 1215.75, 2579.75), "i": (231.0, 2166.25, 3224.0), "u": (252.75, 634.0, 2411.0)}
PRAAT_SPEED_M_S = 353.0
SECTION_M = 5e-3

Moved = tuple[float, float]  # forward and up [mm]
# Scenario -> point, expected direction, and its criterion.
MUSCLES: dict[str, tuple[str, str, Callable[[Moved], bool]]] = {
    "ggp-alone": ("dorsum", "forward", lambda m: m[0] > 0.0),
    "ggm-alone": ("dorsum", "down", lambda m: m[1] < 0.0),
    "hg-alone": ("dorsum", "back and down", lambda m: m[0] < 0.0 and m[1] < 0.0),
    "sty-alone": ("dorsum", "back and up", lambda m: m[0] < 0.0 < m[1]),
    "trans-alone": ("dorsum", "up", lambda m: m[1] > 0.0),
    "mh-alone": ("dorsum", "up", lambda m: m[1] > 0.0),
    "sl-alone": ("tip", "up", lambda m: m[1] > 0.0),
    "il-alone": ("tip", "back and down", lambda m: m[0] < 0.0 and m[1] < 0.0),
    "pg-alone": ("back", "up", lambda m: m[1] > 0.0),
}
# F1 and F2 [Hz], means of 33 men, and of 28 women (Peterson & Barney 1952).
MEN_HZ = {"i": (270.0, 2290.0), "a": (730.0, 1090.0), "u": (300.0, 870.0)}
WOMEN_HZ = {"i": (310.0, 2790.0), "a": (850.0, 1220.0), "u": (370.0, 950.0)}
VOWELS = {"i": "vowel-i-palatal", "a": "vowel-a", "u": "vowel-u"}
COARSE = "model.resolution=coarse"
STOPS, CLOSED_S = ("alveolar-t", "velar-k"), 0.14


def tubes(_: Workshop) -> ClaimFigure:
    """Largest difference [Hz] between the formants of Fant's tubes and those of Praat."""
    off = 0.0
    for vowel, wanted in PRAAT_HZ.items():
        areas = 1e-4 * np.array(FANT_CM2[vowel].split(), dtype=float)
        # Without loss all frequencies are proportional to the speed of sound.
        share = PRAAT_SPEED_M_S / SPEED_OF_SOUND_M_S
        ours = [share * f.frequency_hz for f in formants(Tube(np.full(len(areas), SECTION_M), areas), len(wanted), LOSSLESS)]
        off = max(off, float(np.abs(np.array(ours) - wanted).max()))
    return ClaimFigure(f"nine formants of [a], [i], [u], largest difference {off:.2f} Hz", off)


def muscles(work: Workshop) -> ClaimFigure:
    """Number of muscles that move the tongue in another direction than anatomy textbooks state."""
    wrong = []
    for scenario, (point, should, holds) in MUSCLES.items():
        moved = work.measures(scenario, COARSE).points[point]
        if not holds((moved.forward_mm, moved.up_mm)):
            wrong.append(f"{scenario.partition('-')[0].upper()} does not move the {point} {should}")
    right = len(MUSCLES) - len(wrong)
    return ClaimFigure("; ".join([f"{right} of {len(MUSCLES)} muscles", *wrong]), float(len(wrong)))


def vowel_triangle(work: Workshop) -> ClaimFigure:
    """Number of pairs of vowels, out of five, whose order in F1 or F2 differs from that of speakers."""
    ours = _formants_of_vowels(work)
    orders = [("a", "i", 0), ("a", "u", 0), ("i", "a", 1), ("a", "u", 1), ("i", "u", 1)]
    return ClaimFigure(_text_of(ours), float(sum(ours[high][k] <= ours[low][k] for high, low, k in orders)))


def vowel_formants(work: Workshop) -> ClaimFigure:
    """Largest distance of a formant, as a share of it, from the range between the means of men and of women."""
    ours = _formants_of_vowels(work)
    low, high, here = (np.array([table[vowel] for vowel in VOWELS]) for table in (MEN_HZ, WOMEN_HZ, ours))
    return ClaimFigure(_text_of(ours), float(np.maximum(np.maximum(low / here, here / high) - 1.0, 0.0).max()))


def closure(work: Workshop) -> ClaimFigure:
    """Width [mm] of the wider of the leaks that remain in [t] and in [k], whose velum is deformable."""
    widths, texts = [], []
    for stop in STOPS:
        result = Path(work.run(stop)["result"])
        leak = measure(result, time_s=CLOSED_S).leak
        if leak is None:
            raise RunError(f"{stop}: no leak could be measured.")
        with open_result(result) as opened:
            pressure_kPa = 1e-3 * float(opened.field("contact_pressure_palate", time_s=CLOSED_S).max())
        widths.append(leak.width_mm)
        texts.append(f"{stop} {leak.width_mm:.2f} mm at {pressure_kPa:.1f} kPa")
    return ClaimFigure(", ".join(texts), max(widths))


def crossings(work: Workshop) -> ClaimFigure:
    """Depth [mm] of the deepest point in palate, jaw or pharynx, at any time in five vowels."""
    deepest: dict[str, float] = {}
    for scenario in (*VOWELS.values(), "vowel-e", "vowel-o"):
        with open_result(Path(work.run(scenario, COARSE)["result"])) as opened:
            for bone in ("palate", "jaw", "pharynx"):
                depth_mm = 1e3 * float(np.max(opened.history(f"contact_{bone}_depth")))
                deepest[bone] = max(deepest.get(bone, 0.0), depth_mm)
    return ClaimFigure(", ".join(f"{bone} {depth_mm:.2f} mm" for bone, depth_mm in deepest.items()), max(deepest.values()))


def _formants_of_vowels(work: Workshop) -> dict[str, list[float]]:
    """F1 and F2 [Hz] of each vowel."""
    ours = {}
    for vowel, scenario in VOWELS.items():
        airway = work.measures(scenario, COARSE, formants=True).airway
        if airway is None or len(airway.formants) < 2:
            raise RunError(f"{scenario}: no formants could be computed.")
        ours[vowel] = [formant.frequency_hz for formant in airway.formants[:2]]
    return ours


def _text_of(formants_hz: dict[str, list[float]]) -> str:
    return ", ".join(f"[{vowel}] {first:.0f} {second:.0f} Hz" for vowel, (first, second) in formants_hz.items())
