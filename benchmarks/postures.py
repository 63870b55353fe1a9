"""Random postures with the sides of the tongue on the palate: which muscles are on (docs/studies/speech.md).

    python benchmarks/postures.py [--count 500] [--seed 2022] [--opening 5] [--force-length] [--out outputs/postures.md]

Each of ten muscles at 0, 10 or 25 % of its maximum at random, as in Liu et al. (2022), Phonetica 79:523; their GGP is our GGp
and GGh together, both at the same share (models/tongue/SOURCES.md). Coarse mesh, living tissue, jaw open, ramps of 50 ms, 200
ms. A posture is braced where both sides touch the palate and no node within 3 mm of the midline does; "in front", where they do
so in front of x = 90 mm. The sides lie so near to the palate at rest that the back of them touches in most postures. By chance a
muscle is on in two of three.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mouth import Mouth, Posture, Settled

ROOT = Path(__file__).resolve().parents[1]
SHARES = (0.0, 0.10, 0.25)  # of a muscle's maximum
MUSCLES = {
    "GGA": ("GGa",),
    "GGM": ("GGm",),
    "GGP": ("GGp", "GGh"),
    "STY": ("STY",),
    "HG": ("HG",),
    "VERT": ("VERT",),
    "TRANS": ("TRANS",),
    "IL": ("IL",),
    "SL": ("SL",),
    "MH": ("MH",),
}
# Of 113 547 postures with both sides on the palate and a free centre, counted from the data of Liu et al. (2022): muscle on in %.
LIU_PERCENT = {"GGP": "99-100", "SL": "87-95", "MH": "86-100", "TRANS": "1-9", "HG": "0-2"}


class Ran(NamedTuple):
    """A posture: the level 0, 1 or 2 of each muscle, and what it came to."""

    levels: np.ndarray
    settled: Settled

    @property
    def trouble(self) -> str:
        """Why it is left out of the count; empty where it is not."""
        settled = self.settled
        if settled.status != "finished":
            return settled.status
        if settled.folded:
            return "folded elements"
        if settled.through_itself:
            return "passes through itself"
        return "" if settled.settled else "still moves"


def run(mouth: Mouth, count: int, seed: int, opening_mm: float) -> list[Ran]:
    generator = np.random.default_rng(seed)
    done = []
    begin = time.perf_counter()
    for number in range(count):
        levels = generator.integers(0, len(SHARES), len(MUSCLES))
        forces_N = {
            ours: SHARES[level] * mouth.maxima_N[ours]
            for level, names in zip(levels, MUSCLES.values(), strict=True)
            for ours in names
        }
        done.append(Ran(levels, mouth.settle(Posture(forces_N, opening_mm))))
        if (number + 1) % 50 == 0:
            troubles = Counter(each.trouble for each in done)
            print(f"{number + 1} in {time.perf_counter() - begin:.0f} s: {dict(troubles)}", flush=True)
    return done


def percent(rows: list[Ran], muscle: int) -> str:
    """How often a muscle is on, with the standard error of a share."""
    if not rows:
        return "-"
    share = float(np.mean([each.levels[muscle] > 0 for each in rows]))
    return f"{100 * share:.0f} ± {100 * np.sqrt(share * (1.0 - share) / len(rows)):.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=2022)
    parser.add_argument("--opening", type=float, default=5.0, help="of the jaw, mm")
    parser.add_argument("--mesh", default="coarse")
    parser.add_argument("--force-length", action="store_true", help="muscles pull less as they shorten")
    parser.add_argument("--out", type=Path, default=ROOT / "outputs" / "postures.md")
    arguments = parser.parse_args()
    mouth = Mouth(arguments.mesh, force_length=arguments.force_length)
    done = run(mouth, arguments.count, arguments.seed, arguments.opening)
    good = [each for each in done if not each.trouble]
    usable = [each for each in done if each.trouble in ("", "still moves")]
    groups = {
        "all": done,
        "settled": good,
        "sides on the palate": [each for each in good if each.settled.left and each.settled.right],
        "braced": [each for each in good if each.settled.braced],
        "braced in front": [each for each in good if each.settled.braced_in_front],
        "braced in front, or still moving": [each for each in usable if each.settled.braced_in_front],
        "braced, STY off": [each for each in good if each.settled.braced and not each.levels[list(MUSCLES).index("STY")]],
    }
    lines = [f"| muscle on, % | {' | '.join(f'{name} ({len(rows)})' for name, rows in groups.items())} | Liu et al., braced |"]
    lines.append("|---" * (len(groups) + 2) + "|")
    for number, name in enumerate(MUSCLES):
        lines.append(
            f"| {name} | {' | '.join(percent(rows, number) for rows in groups.values())} | {LIU_PERCENT.get(name, '')} |"
        )
    troubles = Counter(each.trouble or "settled" for each in done)
    lines.append("")
    lines.append("; ".join(f"{count} {what}" for what, count in troubles.most_common()) + f" of {len(done)}")
    balance = max(each.settled.balance_error for each in done)
    lines.append(f"largest error of the energy balance {balance:.0e}")
    text = "\n".join(lines)
    print(text)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
