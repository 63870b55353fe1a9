"""Forces and jaw openings of vowels and stops, by a search over where phonetics puts the tongue: scenarios/vowel-a.toml etc.

    python studies/benchmarks/posture_search.py [SOUND ...] [--mesh medium] [--starts 3] [--seed 1] [--out FOLDER]

The literature has no forces of single muscles for these sounds that could be read, so they are searched, and not tuned by hand.

Unknowns: the force of every muscle, from 0 to 15 % of its maximum (25 % for [k], as in Liu et al. 2022), and the opening of the
jaw within the bounds of the sound. 200 ms, ramps of 50 ms.

Goals: bands for what is measured of the settled tongue, in ``GOALS``. Residuals are the distances from the bands, in mm or in
what weighs as much (``UNITS``), and the effort of each muscle, so that of two postures that meet the bands the one of less
effort is taken. A run that fails or folds an element counts as 10 mm, one that does not stand still, contact where there shall
be none or none where it shall be as 3 mm; hourglass energy beyond 9.5 % as much as 1 mm for each 1 %.

Search: ``--tries`` postures at random on the coarse mesh, each muscle on with 30 % probability, at a share between 0.5 and 15 %
evenly in its logarithm. From each of the best ``--starts`` of them, least squares with bounds (Levenberg, Marquardt): the
derivatives by differences, each step the best of several lengths. The best end is the start on the mesh that was asked for.
At the end muscles below 0.3 % are left out, forces are rounded to two digits, and each muscle in turn is left out where that
does not raise the sum of squares by more than 0.1.

Where the goals come from. Wood (1979), J. Phonetics 7:25-43: vowels narrow the tract at the hard palate, at the soft palate, in
the upper or in the lower pharynx; that [i] and [e] belong to the first, [u] to the second and [a] to the last is phonetics'
common ground, and the open, mid and closed jaw too, and a tip that stays low. Gibbon, Lee & Yuen (2010): in [i] the sides touch
the palate and the centre is free. Stops close the tract: [t] behind the teeth, [k] at the soft palate, with the pressure of
tongues in speech, 0.2 to 3 kPa. The widths of the bands in mm are choices of this project.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from mouth import Air, Mouth, Posture, Settled
from scipy.optimize import lsq_linear

ROOT = Path(__file__).resolve().parents[2]
LARGEST_SHARE, SMALLEST_SHARE = 0.15, 0.005  # of a muscle's maximum
ON_PROBABILITY = 0.3
LEFT_OUT_SHARE = 0.003
LEFT_OUT_LOSS = 0.1  # a muscle that is worth less than this is left out: 0.3 mm from a band
EFFORT = 2.6  # residual of a muscle at its maximum: at 15 % it weighs as much as 0.4 mm
DIFFERENCE_SHARE, DIFFERENCE_MM = 0.003, 0.2  # for the derivatives
DAMPING = (0.01, 0.1, 1.0, 10.0)  # of the steps that are tried together, in units of the scaled unknowns
ROUNDS = 15  # most steps from a start
LEAST_PROGRESS = 0.01  # of the sum of squares, below which a search ends
# A run warns of hourglass energy from 10 % on; so much more of it weighs like a mm.
MOST_HOURGLASS, HOURGLASS_PER_MM = 0.095, 0.01
# The narrow part of [i], a choice (Fant 1960, X-ray areas: 50 to 95 mm2 over 30 mm): area, length, and where it ends.
NARROW_MM2, NARROW_MM, NARROW_END_MM = 34.0, 41.0, (12.0, 40.0)
CLOSED = 3.0  # how far from its bands, in their units, a formant is that a closed tract does not have
WRONG = 3.0  # residual of contact where there shall be none, or none where it shall be, and of what still moves
REFUSED = 10.0  # residual of a posture that cannot be used


@dataclass(frozen=True)
class Goal:
    """Where the tongue of a sound shall settle.

    Attributes
    ----------
    jaw_mm : bounds of the opening.
    bands : measure -> smallest and largest value. ``teeth``, ``hard palate``, ``soft palate``: midsagittal gap, mm; ``forward``,
        ``up``: of the highest point against rest, mm; ``tip up``, ``root back``: mm; ``place``: of the narrowest place along the
        palate, mm; ``pressure``: highest on the palate, kPa; ``F1``, ``F2``: Hz; ``area``: of the narrowest section, mm2;
        ``narrow``: length of the tract that is no wider than 35 mm2, mm; ``excess``: mean area beyond that over the
        40 mm that are narrowest, of those that end 12 to 40 mm behind the incisors, mm2.
    sides : whether both sides shall touch the palate; None where that is left open.
    midline_free : whether the midline shall be free of the palate.
    muscles : those that may pull; all if left out.
    largest_share : of a muscle's maximum, with which it may pull.
    lips : their opening in mm2 and length in mm; None asks for no formants.
    """

    jaw_mm: tuple[float, float]
    bands: dict[str, tuple[float, float]]
    sides: bool | None
    midline_free: bool
    muscles: tuple[str, ...] | None = None
    largest_share: float = LARGEST_SHARE
    lips: tuple[float, float] | None = None


HIGH = np.inf
# Muscles that raise the back of the tongue, and one that flattens it: with all twelve, 200 turns found no [u] and no [k].
RAISING = ("STY", "GGp", "MH", "VERT")
# For [k] one that narrows it instead: without, nothing but the end of the velum was reached.
NARROWING = ("STY", "GGp", "MH", "TRANS")
# Measures that are not mm or kPa: how much of them weighs as much as 1 mm.
UNITS = {"F1": 30.0, "F2": 100.0, "area": 10.0, "narrow": 5.0, "excess": 5.0, "place": 5.0}
GOALS = {
    "i": Goal(
        (-4.0, 1.0),
        {"F1": (0.0, 300.0), "F2": (2350.0, HIGH), "area": (16.0, 34.0), "excess": (0.0, 0.0),
         "teeth": (1.5, HIGH), "tip up": (-HIGH, 3.0)},
        sides=True,
        midline_free=True,
        lips=(250.0, 5.0),
    ),
    "e": Goal(
        (0.0, 4.0),
        {"F1": (370.0, 450.0), "F2": (1950.0, HIGH), "teeth": (3.0, HIGH), "tip up": (-HIGH, 1.0)},
        sides=None,
        midline_free=True,
        lips=(200.0, 8.0),
    ),
    "a": Goal(
        (7.0, 12.0),
        {"F1": (720.0, 830.0), "F2": (1120.0, 1210.0), "hard palate": (10.0, HIGH)},
        sides=False,
        midline_free=True,
        lips=(450.0, 10.0),
    ),
    "o": Goal(
        (2.0, 7.0),
        {"F1": (430.0, 570.0), "F2": (700.0, 900.0), "hard palate": (8.0, HIGH), "soft palate": (3.0, HIGH),
         "tip up": (-HIGH, 1.0)},
        sides=None,
        midline_free=True,
        lips=(60.0, 12.0),
    ),
    "u": Goal(
        (-3.0, 1.0),
        {"F1": (0.0, 340.0), "F2": (650.0, 850.0), "place": (60.0, 92.0), "soft palate": (1.5, HIGH), "teeth": (8.0, HIGH),
         "tip up": (-HIGH, 1.0)},
        sides=None,
        midline_free=True,
        lips=(15.0, 15.0),
    ),
    "t": Goal(
        (-4.0, 0.0),
        {"teeth": (0.0, 0.0), "place": (0.0, 20.0), "hard palate": (2.5, HIGH), "pressure": (1.0, 2.5)},
        sides=True,
        midline_free=False,
        muscles=("SL", "GGm"),
    ),
    "k": Goal(
        (-2.0, 4.0),
        {"soft palate": (0.0, 0.0), "place": (50.0, 90.0), "root back": (-HIGH, 8.0), "teeth": (5.5, HIGH),
         "pressure": (0.8, 2.7), "tip up": (-HIGH, 2.0)},
        sides=True,
        midline_free=False,
        muscles=NARROWING,
        largest_share=0.25,
    ),
}  # fmt: skip


def measured(settled: Settled, air: Air | None) -> dict[str, float]:
    """The measures that bands are for; a closed tract has no formants."""
    forward, up = settled.highest_mm
    acoustic = {"F1": np.nan, "F2": np.nan, "area": 0.0, "narrow": 0.0, "excess": np.nan}
    if air is not None:
        smallest = min(piece.area_mm2 for piece in air.pieces)
        acoustic = {"F1": air.F1, "F2": air.F2, "area": smallest, "narrow": air.narrow_mm(NARROW_MM2)}
        acoustic["excess"] = air.excess_mm2(NARROW_MM2, NARROW_MM, NARROW_END_MM)
    return (
        settled.gap_mm
        | acoustic
        | {
            "forward": forward,
            "up": up,
            "tip up": settled.tip_mm[1],
            "root back": settled.root_back_mm,
            "place": settled.narrowest_mm,
            "pressure": settled.peak_kPa,
        }
    )


@lru_cache(maxsize=2)
def mouth_of(mesh: str) -> Mouth:
    """The mouth of a resolution, once in each process."""
    return Mouth(mesh)


@dataclass(frozen=True)
class Search:
    """One search: unknowns (muscles + 1,) are the shares of the maxima and the opening in mm."""

    mesh: str
    goal: Goal

    @property
    def mouth(self) -> Mouth:
        return mouth_of(self.mesh)

    @property
    def muscles(self) -> list[str]:
        return list(self.mouth.maxima_N)

    @property
    def named(self) -> np.ndarray:
        """Muscles (m,) that the goal names: they are on in every random posture."""
        return np.isin(self.muscles, self.goal.muscles or ())

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest unknowns."""
        barred = ~self.named & (self.goal.muscles is not None)
        low, high = self.goal.jaw_mm
        return np.append(np.zeros(len(barred)), low), np.append(np.where(barred, 0.0, self.goal.largest_share), high)

    def posture(self, unknowns: np.ndarray) -> Posture:
        forces_N = {name: share * self.mouth.maxima_N[name] for name, share in zip(self.muscles, unknowns, strict=False) if share}
        return Posture(forces_N, float(unknowns[-1]))

    def seen(self, unknowns: np.ndarray, settled: Settled) -> dict[str, float]:
        """The measures of a posture."""
        asked = self.goal.lips is not None and settled.whole
        return measured(settled, self.mouth.air(self.posture(unknowns), settled, self.goal.lips) if asked else None)

    def residual(self, unknowns: np.ndarray) -> np.ndarray:
        """How far a posture is from each band, mm or what weighs as much; what it should not do; the effort of each muscle."""
        settled = self.mouth.settle(self.posture(unknowns))
        wrong_contact = settled.midline_free != self.goal.midline_free or (
            self.goal.sides is not None and (settled.left and settled.right) != self.goal.sides
        )
        seen = self.seen(unknowns, settled)
        off = []
        for name, (low, high) in self.goal.bands.items():
            beyond = max(seen[name] - high, 0.0) - max(low - seen[name], 0.0)
            off.append(beyond / UNITS.get(name, 1.0) if np.isfinite(beyond) else CLOSED)
        off += [max(0.0, settled.hourglass_share - MOST_HOURGLASS) / HOURGLASS_PER_MM, WRONG * wrong_contact]
        refused = [REFUSED * (not settled.whole), WRONG * (not settled.settled)]
        return np.concatenate([off, refused, EFFORT * unknowns[:-1]])

    def random(self, generator: np.random.Generator) -> np.ndarray:
        low, high = self.bounds
        shares = np.exp(generator.uniform(np.log(SMALLEST_SHARE), np.log(self.goal.largest_share), len(low) - 1))
        shares[(generator.random(len(shares)) > ON_PROBABILITY) & ~self.named] = 0.0
        return np.append(np.minimum(shares, high[:-1]), generator.uniform(low[-1], high[-1]))


def lowest(search: Search, begin: np.ndarray, pool: ProcessPoolExecutor) -> tuple[np.ndarray, float]:
    """Least squares with bounds from a posture: unknowns and sum of squares."""
    low, high = search.bounds
    free = np.flatnonzero(high > low)
    step = np.append(np.full(len(low) - 1, DIFFERENCE_SHARE), DIFFERENCE_MM)
    scale = (high - low)[free]
    best = begin
    (residual,) = residuals(search, [best], pool)
    for _ in range(ROUNDS):
        ways = np.where(best + step > high, -step, step)
        moved = [best + ways * (np.arange(len(best)) == number) for number in free]
        slopes = np.column_stack(
            [(one - residual) / ways[number] for one, number in zip(residuals(search, moved, pool), free, strict=True)]
        )
        tried = []
        for damping in DAMPING:
            matrix = np.vstack([slopes * scale, np.sqrt(damping) * np.eye(len(free))])
            right = np.concatenate([-residual, np.zeros(len(free))])
            limits = (low - best)[free] / scale - 1e-9, (high - best)[free] / scale + 1e-9
            new = best.copy()
            new[free] += scale * lsq_linear(matrix, right, limits).x
            tried.append(np.clip(new, low, high))
        answers = residuals(search, tried, pool)
        number = int(np.argmin([one @ one for one in answers]))
        before, after = residual @ residual, answers[number] @ answers[number]
        if after < before:
            best, residual = tried[number], answers[number]
        if after > (1.0 - LEAST_PROGRESS) * before:
            break
    return best, float(residual @ residual)


def residuals(search: Search, postures: Sequence[np.ndarray], pool: ProcessPoolExecutor) -> list[np.ndarray]:
    return list(pool.map(search.residual, postures))


def rounded(search: Search, unknowns: np.ndarray, pool: ProcessPoolExecutor) -> tuple[np.ndarray, float]:
    """Forces with two digits, the opening in halves of a millimetre, muscles of no use left out; and the sum of squares."""
    maxima = np.array(list(search.mouth.maxima_N.values()))
    shares = np.where(unknowns[:-1] < LEFT_OUT_SHARE, 0.0, unknowns[:-1])
    final = np.append([float(f"{force:.2g}") for force in shares * maxima], 0.5 * np.round(2.0 * unknowns[-1]))
    final[:-1] /= maxima
    (residual,) = residuals(search, [final], pool)
    loss = float(residual @ residual)
    while np.any(final[:-1] > 0.0):
        fewer = [np.where(np.arange(len(final)) == number, 0.0, final) for number in np.flatnonzero(final[:-1] > 0.0)]
        losses = [float(one @ one) for one in residuals(search, fewer, pool)]
        if min(losses) >= loss + LEFT_OUT_LOSS:
            break
        final, loss = fewer[int(np.argmin(losses))], min(losses)
    return final, loss


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("sounds", nargs="*", default=list(GOALS))
    parser.add_argument("--tries", type=int, default=100)
    parser.add_argument("--starts", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--mesh", default="medium")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, default=ROOT / "outputs" / "postures")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(arguments.processes) as pool:
        for sound in arguments.sounds:
            coarse, search = Search("coarse", GOALS[sound]), Search(arguments.mesh, GOALS[sound])
            generator = np.random.default_rng(arguments.seed)
            postures = [coarse.random(generator) for _ in range(arguments.tries)]
            losses = [float(one @ one) for one in residuals(coarse, postures, pool)]
            print(f"[{sound}] best of {len(postures)} at random: {min(losses):.1f}", flush=True)
            ends = []
            for number in np.argsort(losses)[: arguments.starts]:
                ends.append(lowest(coarse, postures[number], pool))
                print(f"  {losses[number]:.1f} -> {ends[-1][1]:.2f}", flush=True)
            best, _ = min(ends, key=lambda end: end[1])
            if arguments.mesh != "coarse":
                best, _ = lowest(search, best, pool)
            best, loss = rounded(search, best, pool)
            posture = search.posture(best)
            settled = search.mouth.settle(posture)
            forces_N = {name: round(float(force), 6) for name, force in posture.forces_N.items()}
            seen = {name: round(value, 2) for name, value in search.seen(best, settled).items()}
            print(f"  sum of squares {loss:.3f}: {forces_N} N, jaw {posture.opening_mm} mm")
            print(f"  {seen}, sides {settled.left and settled.right}, midline free {settled.midline_free}", flush=True)
            answer = {"sound": sound, "loss": loss, "forces_N": forces_N, "opening_mm": posture.opening_mm, "measures": seen}
            (arguments.out / f"{sound}.json").write_text(json.dumps(answer, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
