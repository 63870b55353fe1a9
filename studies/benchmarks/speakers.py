"""Mean and spread of F1 and F2 of the speakers of Peterson and Barney (1952): writes explicitfe/results/acoustics/speakers.csv.

Their measurements come with Praat: ``pip install praat-parselmouth``, then ``python studies/benchmarks/speakers.py``. Men, women
and children read ten words twice. The table has the mean of all utterances, the standard deviations and the correlation.
"""

from __future__ import annotations

from collections import defaultdict
from itertools import product
from pathlib import Path

import numpy as np
import parselmouth

TABLE = Path(__file__).parents[2] / "explicitfe" / "results" / "acoustics" / "speakers.csv"
GROUPS = {"m": "men", "w": "women", "c": "children"}
VOWELS = {"iy": "i", "ih": "ɪ", "eh": "ɛ", "ae": "æ", "aa": "ɑ", "ao": "ɔ", "uh": "ʊ", "uw": "u", "ah": "ʌ", "er": "ɝ"}
HEAD = """\
# F1 and F2 of speakers of American English in the words heed, hid, head, had, hod, hawed, hood, who'd, hud and heard:
# 33 men, 28 women and 15 children, two utterances each.
# Source: G. E. Peterson and H. L. Barney, J. Acoust. Soc. Am. 24:175 (1952).
# Statistics of the single measurements as Praat 6.1.38 contains them, by studies/benchmarks/speakers.py. The measurements
# themselves are not copied: Praat, under the GNU General Public License, has them from a file of the University of Pennsylvania.
group,vowel,utterances,F1_hz,F2_hz,F1_sd_hz,F2_sd_hz,correlation
"""


def main() -> None:
    """Write the table."""
    table = parselmouth.praat.call("Create formant table (Peterson & Barney 1952)")
    measured = defaultdict(list)
    for row in range(1, parselmouth.praat.call(table, "Get number of rows") + 1):
        group, vowel, *formants = (
            parselmouth.praat.call(table, "Get value", row, column) for column in ("Type", "Vowel", "F1", "F2")
        )
        measured[group, vowel].append([float(each) for each in formants])
    rows = []
    for group, vowel in product(GROUPS, VOWELS):
        values = measured[group, vowel]
        (f1, f2), (sd1, sd2) = np.mean(values, axis=0), np.std(values, axis=0, ddof=1)
        correlation = np.corrcoef(np.transpose(values))[0, 1]
        rows.append(f"{GROUPS[group]},{VOWELS[vowel]},{len(values)},{f1:.1f},{f2:.1f},{sd1:.1f},{sd2:.1f},{correlation:.3f}\n")
    TABLE.write_text(HEAD + "".join(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
