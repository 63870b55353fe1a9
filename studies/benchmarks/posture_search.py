"""Forces and jaw openings of vowels and stops, by a search over where phonetics puts the tongue: scenarios/vowel-a.toml etc.

    python studies/benchmarks/posture_search.py [SOUND ...] [--tries 70] [--turns 130] [--seed 1] [--out FOLDER]

The literature has no forces of single muscles for these sounds that could be read, so they are searched, and not tuned by hand.

Unknowns: the force of every muscle, from 0 to 15 % of its maximum (25 % for [k], as in Liu et al. 2022), and the opening of the
jaw within the bounds of the sound. Coarse mesh, 200 ms, ramps of 50 ms.

Goals: bands for what is measured of the settled tongue, in ``GOALS``; the loss is the sum of (distance from the band / 1 mm or
1 kPa)^2 and of the muscles' shares of their maxima, so that of two postures that meet the bands the one of less effort is
taken. A run that fails, does not stand still, or folds an element costs 100, hourglass energy beyond 11 % as much as 1 mm for
each 1 %, contact where there shall be none or none where it shall be 10.

Search: ``--tries`` postures at random, each muscle on with 30 % probability, at a share between 0.5 and 15 % evenly in its
logarithm; then from the best of them ``--turns`` changes of one or two unknowns, each kept if it is better: a factor that
narrows from e^0.7 to e^0.15, a muscle on or off, a shift of the jaw by 1.5 mm down to 0.3 mm. At the end muscles below 0.3 %
are left out, forces are rounded to two digits, and each muscle in turn is left out where that does not raise the loss by more
than 0.02.

Where the goals come from. Wood (1979), J. Phonetics 7:25-43: vowels narrow the tract at the hard palate, at the soft palate, in
the upper or in the lower pharynx; that [i] and [e] belong to the first, [u] to the second and [a] to the last is phonetics'
common ground, and the open, mid and closed jaw too, and a tip that stays low. Gibbon, Lee & Yuen (2010): in [i] the sides touch
the palate and the centre is free. Stops close the tract: [t] behind the teeth, [k] at the soft palate, with the pressure of
tongues in speech, 0.2 to 3 kPa. The widths of the bands in mm are choices of this project.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mouth import Mouth, Posture, Settled

ROOT = Path(__file__).resolve().parents[2]
LARGEST_SHARE, SMALLEST_SHARE = 0.15, 0.005  # of a muscle's maximum
ON_PROBABILITY = 0.3
LEFT_OUT_SHARE = 0.003
LEFT_OUT_LOSS = 0.1  # a muscle that is worth less than this is left out: 0.3 mm from a band
# A run warns of hourglass energy from 10 % on, of which the medium mesh has a fifth less; so much more of it weighs like a mm.
MOST_HOURGLASS, HOURGLASS_PER_MM = 0.11, 0.01
REFUSED = 100.0  # loss of a posture that cannot be used


@dataclass(frozen=True)
class Goal:
    """Where the tongue of a sound shall settle.

    Attributes
    ----------
    jaw_mm : bounds of the opening.
    bands : measure -> smallest and largest value. ``teeth``, ``hard palate``, ``soft palate``: midsagittal gap, mm; ``forward``,
        ``up``: of the highest point against rest, mm; ``tip up``, ``root back``: mm; ``place``: of the narrowest place along the
        palate, mm; ``pressure``: highest on the palate, kPa.
    sides : whether both sides shall touch the palate; None where that is left open.
    midline_free : whether the midline shall be free of the palate.
    muscles : those that may pull; all if left out.
    largest_share : of a muscle's maximum, with which it may pull.
    """

    jaw_mm: tuple[float, float]
    bands: dict[str, tuple[float, float]]
    sides: bool | None
    midline_free: bool
    muscles: tuple[str, ...] | None = None
    largest_share: float = LARGEST_SHARE


HIGH = np.inf
# Muscles that raise the back of the tongue, and one that flattens it: with all twelve, 200 turns found no [u] and no [k].
RAISING = ("STY", "GGp", "MH", "VERT")
# For [k] one that narrows it instead: without, nothing but the end of the velum was reached.
NARROWING = ("STY", "GGp", "MH", "TRANS")
GOALS = {
    "i": Goal(
        (-4.0, 1.0),
        {"hard palate": (1.5, 2.5), "place": (15.0, 45.0), "teeth": (1.5, HIGH), "forward": (4.0, HIGH), "up": (2.0, HIGH),
         "root back": (-HIGH, -3.0), "tip up": (-HIGH, 3.0)},
        sides=True,
        midline_free=True,
    ),
    "e": Goal(
        (0.0, 4.0),
        {"hard palate": (4.0, 5.0), "place": (15.0, 50.0), "teeth": (4.0, HIGH), "forward": (2.0, HIGH), "up": (0.5, 2.0),
         "root back": (-HIGH, -1.5), "tip up": (-HIGH, 1.0)},
        sides=None,
        midline_free=True,
    ),
    "a": Goal(
        (7.0, 12.0),
        {"up": (-HIGH, -5.0), "forward": (-HIGH, -2.0), "root back": (6.0, HIGH), "hard palate": (13.0, HIGH),
         "soft palate": (6.0, HIGH)},
        sides=False,
        midline_free=True,
    ),
    "u": Goal(
        (-3.0, 1.0),
        {"soft palate": (2.5, 3.5), "place": (60.0, 92.0), "forward": (-HIGH, -3.0), "up": (3.0, HIGH), "teeth": (10.0, HIGH),
         "hard palate": (5.0, HIGH), "root back": (-HIGH, 4.0), "tip up": (-HIGH, 1.0)},
        sides=None,
        midline_free=True,
        muscles=RAISING,
    ),
    "t": Goal(
        (-4.0, 0.0),
        {"teeth": (0.0, 0.0), "place": (0.0, 20.0), "hard palate": (2.5, HIGH), "pressure": (0.5, 2.5)},
        sides=True,
        midline_free=False,
        muscles=("SL", "GGm"),
    ),
    "k": Goal(
        (-2.0, 4.0),
        {"soft palate": (0.0, 0.0), "place": (50.0, 90.0), "root back": (-HIGH, 8.0), "teeth": (5.5, HIGH),
         "pressure": (0.5, 3.2), "tip up": (-HIGH, 2.0)},
        sides=True,
        midline_free=False,
        muscles=NARROWING,
        largest_share=0.25,
    ),
}  # fmt: skip


def measured(settled: Settled) -> dict[str, float]:
    """The measures that bands are for."""
    forward, up = settled.highest_mm
    return settled.gap_mm | {
        "forward": forward,
        "up": up,
        "tip up": settled.tip_mm[1],
        "root back": settled.root_back_mm,
        "place": settled.narrowest_mm,
        "pressure": settled.peak_kPa,
    }


@dataclass
class Search:
    """One search: unknowns (muscles + 1,) are the shares of the maxima and the opening in mm."""

    mouth: Mouth
    goal: Goal
    generator: np.random.Generator

    @property
    def muscles(self) -> list[str]:
        return list(self.mouth.maxima_N)

    @property
    def named(self) -> np.ndarray:
        """Muscles (m,) that the goal names: they are on in every random posture."""
        return np.isin(self.muscles, self.goal.muscles or ())

    @property
    def barred(self) -> np.ndarray:
        """Muscles (m,) that may not pull."""
        return ~self.named & (self.goal.muscles is not None)

    def posture(self, unknowns: np.ndarray) -> Posture:
        forces_N = {name: share * self.mouth.maxima_N[name] for name, share in zip(self.muscles, unknowns, strict=False) if share}
        return Posture(forces_N, float(unknowns[-1]))

    def loss(self, unknowns: np.ndarray) -> float:
        settled = self.mouth.settle(self.posture(unknowns))
        wrong_contact = settled.midline_free != self.goal.midline_free or (
            self.goal.sides is not None and (settled.left and settled.right) != self.goal.sides
        )
        seen = measured(settled)
        off = [max(low - seen[name], 0.0, seen[name] - high) for name, (low, high) in self.goal.bands.items()]
        off.append(max(0.0, settled.hourglass_share - MOST_HOURGLASS) / HOURGLASS_PER_MM)
        return REFUSED * (not settled.sound) + 10.0 * wrong_contact + float(np.square(off).sum() + unknowns[:-1].sum())

    def random(self) -> np.ndarray:
        shares = np.exp(self.generator.uniform(np.log(SMALLEST_SHARE), np.log(self.goal.largest_share), len(self.muscles)))
        off = self.generator.random(len(shares)) > ON_PROBABILITY
        shares[off & ~self.named | self.barred] = 0.0
        return np.append(shares, self.generator.uniform(*self.goal.jaw_mm))

    def changed(self, unknowns: np.ndarray, done: float) -> np.ndarray:
        """The unknowns with one or two of them changed, after a share of the turns is done."""
        new, width = unknowns.copy(), np.exp(np.log(0.7) + done * np.log(0.15 / 0.7))
        free = np.flatnonzero(~np.append(self.barred, False))
        for number in self.generator.choice(free, self.generator.integers(1, 3), replace=False):
            if number == len(self.muscles):
                new[-1] += (1.5 + done * (0.3 - 1.5)) * self.generator.normal()
            elif new[number] == 0.0:
                new[number] = SMALLEST_SHARE * np.exp(self.generator.uniform(0.0, 1.5))
            elif self.generator.random() < 0.2:
                new[number] = 0.0
            else:
                new[number] *= np.exp(width * self.generator.normal())
        new[:-1] = np.minimum(new[:-1], self.goal.largest_share)
        new[-1] = np.clip(new[-1], *self.goal.jaw_mm)
        return new

    def run(self, tries: int, turns: int) -> tuple[np.ndarray, float]:
        """The best unknowns and their loss."""
        best, least = np.zeros(len(self.muscles) + 1), np.inf
        for turn in range(tries + turns):
            new = self.random() if turn < tries else self.changed(best, (turn - tries) / turns)
            loss = self.loss(new)
            if loss < least:
                best, least = new, loss
        return self.rounded(best)

    def rounded(self, unknowns: np.ndarray) -> tuple[np.ndarray, float]:
        """Forces with two digits, the opening in halves of a millimetre, muscles of no use left out; and the loss of that."""
        maxima = np.array(list(self.mouth.maxima_N.values()))
        shares = np.where(unknowns[:-1] < LEFT_OUT_SHARE, 0.0, unknowns[:-1])
        forces = np.array([float(f"{force:.2g}") for force in shares * maxima])
        final = np.append(forces / maxima, 0.5 * np.round(2.0 * unknowns[-1]))
        loss = self.loss(final)
        for number in np.argsort(final[:-1]):
            without = np.where(np.arange(len(final)) == number, 0.0, final)
            if final[number] > 0.0 and (less := self.loss(without)) < loss + LEFT_OUT_LOSS:
                final, loss = without, less
        return final, loss


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("sounds", nargs="*", default=list(GOALS))
    parser.add_argument("--tries", type=int, default=70)
    parser.add_argument("--turns", type=int, default=130)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--mesh", default="coarse")
    parser.add_argument("--out", type=Path, default=ROOT / "outputs" / "postures")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    mouth = Mouth(arguments.mesh)
    for sound in arguments.sounds:
        goal = GOALS[sound]
        print(f"[{sound}] jaw {goal.jaw_mm} mm, muscles 0 to {goal.largest_share:.0%} of {mouth.maxima_N}")
        print(f"  bands {goal.bands}, sides {goal.sides}, midline free {goal.midline_free}", flush=True)
        search = Search(mouth, goal, np.random.default_rng(arguments.seed))
        best, loss = search.run(arguments.tries, arguments.turns)
        posture = search.posture(best)
        settled = mouth.settle(posture)
        forces_N = {name: round(force, 6) for name, force in posture.forces_N.items()}
        seen = {name: round(value, 2) for name, value in measured(settled).items()}
        print(f"  loss {loss:.3f}: {forces_N} N, jaw {posture.opening_mm} mm")
        print(f"  {seen}, sides {settled.left and settled.right}, midline free {settled.midline_free}", flush=True)
        answer = {"sound": sound, "loss": loss, "forces_N": forces_N, "opening_mm": posture.opening_mm, "measures": seen}
        (arguments.out / f"{sound}.json").write_text(json.dumps(answer, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
