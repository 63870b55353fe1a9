"""F1 and F2 of speakers: statistics of the measurements of Peterson and Barney (1952), see ``speakers.csv``."""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

TABLE = Path(__file__).with_name("speakers.csv")


class SpokenVowel(NamedTuple):
    """A vowel of a group of speakers.

    Attributes
    ----------
    group, vowel : "men", "women" or "children", and a letter of the International Phonetic Alphabet.
    utterances : number of measurements.
    mean_hz, deviation_hz : (2,) F1 and F2, and their standard deviations.
    correlation : of F1 and F2.
    """

    group: str
    vowel: str
    utterances: int
    mean_hz: np.ndarray
    deviation_hz: np.ndarray
    correlation: float

    def ellipse(self, deviations: float, count: int = 49) -> np.ndarray:
        """Points (count, 2) Hz, the last as the first, at a Mahalanobis distance of so many ``deviations`` from the mean."""
        turn = np.linspace(0.0, 2.0 * np.pi, count)
        first = np.cos(turn)
        second = self.correlation * first + np.sqrt(1.0 - self.correlation**2) * np.sin(turn)
        return self.mean_hz + deviations * self.deviation_hz * np.column_stack([first, second])


@cache
def spoken_vowels() -> tuple[SpokenVowel, ...]:
    """The vowels of men, women and children, one group after the other."""
    lines = [line for line in TABLE.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return tuple(
        SpokenVowel(
            row["group"],
            row["vowel"],
            int(row["utterances"]),
            np.array([float(row["F1_hz"]), float(row["F2_hz"])]),
            np.array([float(row["F1_sd_hz"]), float(row["F2_sd_hz"])]),
            float(row["correlation"]),
        )
        for row in csv.DictReader(lines)
    )
