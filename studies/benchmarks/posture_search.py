"""Forces and jaw openings of vowels and stops, by a random search over what is measured of them: scenarios/vowel-a.toml etc.

    python studies/benchmarks/posture_search.py [SOUND ...] [--mesh medium] [--seconds 120] [--seed 1] [--out FOLDER]

The literature has no forces of single muscles for these sounds that could be read, so they are searched.

Unknowns: the forces of the muscles that ``GOALS`` names, up to a quarter of their maxima, and the opening of the jaw. Vowels
are measured at 200 ms after ramps of 50 ms, stops at 140 ms after ramps of 80 ms.

Residuals: distances of formants from bands, 20 Hz of F1 and 60 Hz of F2 weighing like one; electrodes that speakers touch and
the tongue does not, and the reverse, in mm; of stops the leak beyond 0.12 mm, the gaps of the nearest of the wanted rows and
those at the sides beyond 0.2 mm, and the pressure beyond its band, 0.3 kPa weighing like one; gaps in the midline that shall
stay open; hourglass energy beyond 9 %; and the effort of each muscle, its share of the maximum times 1.5. A run that does not
end counts as 140. ``--mesh both`` searches for what is right on the medium and on the fine mesh.

Search: from the forces of ``GOALS``, eight variations at a time of one of the four best postures: each force times the
exponential of a normal number, at first of 0.18, some muscles switched on or off, the jaw moved by 0.5 mm. At the end forces
have two digits.

Where the goals come from. F1 and F2: Peterson & Barney (1952), means of men and women. Electrodes of [i]: in rows from the
back 7 6 4 4 3 2 1 0, 27 in the mean of speakers. Stops: Gibbon, Yuen, Lee & Adams (2007), closed in front and at both sides;
[k] fills the last row; pressures of tongues in speech, 0.2 to 3 kPa.
"""

from __future__ import annotations

import argparse
import json
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
from mouth import Mouth, Posture, Settled

from explicitfe.fem.mesh.triangles import corners_of, surface_triangles
from explicitfe.results.measure.electrodes import ELECTRODE_COLUMNS, HARD_PALATE_M, Electrodes, electrodes
from explicitfe.results.measure.leak import Leak, gaps_below, leak_in
from explicitfe.results.measure.roof_grid import OnTriangles, RoofGrid, clearance, roof_grid, surface_samples
from explicitfe.results.measure.tract import palate_midline

ROOT = Path(__file__).resolve().parents[2]
LARGEST_SHARE = 0.25  # of a muscle's maximum
REFUSED = 140.0  # loss of a posture whose run does not end
SAMPLES_TRIED = 4  # of the tongue, nearest to a point
CANDIDATES, KEPT = 8, 4
JAW_STEP_MM = 0.5
HOURGLASS_SHARE = 0.09


@dataclass(frozen=True)
class Goal:
    """What a sound asks for.

    Attributes
    ----------
    start : forces in N from which the search begins; their muscles are those that may pull, with ``more``.
    jaw_mm : opening at the start; ``bounds_mm`` of it.
    lips : opening in mm2 and length in mm; None asks for no formants.
    F1, F2 : bands, Hz.
    touched : number of electrodes in each row from the front, half of them from each side; None asks for none.
    rows : rows (from 0) of which one shall be complete; a stop has them.
    sides_mm : between these places along the midline the sides of a stop shall touch.
    kPa : band of the largest pressure of a stop.
    open_mm : region of ``mouth.REGIONS_MM`` -> smallest gap in the midline.
    """

    start: dict[str, float]
    jaw_mm: float
    bounds_mm: tuple[float, float]
    more: tuple[str, ...] = ()
    lips: tuple[float, float] | None = None
    F1: tuple[float, float] = (0.0, np.inf)
    F2: tuple[float, float] = (0.0, np.inf)
    touched: tuple[int, ...] | None = None
    rows: tuple[int, ...] = ()
    sides_mm: tuple[float, float] = (0.0, 0.0)
    kPa: tuple[float, float] = (0.8, 2.5)
    open_mm: dict[str, float] = field(default_factory=dict)


GOALS = {
    "i": Goal({"GGp": 4.0, "GGh": 1.8, "STY": 3.0, "TRANSa": 0.9, "TRANSm": 1.6, "TRANSp": 1.0, "VERTa": 0.4, "MH": 2.5}, -3.5,
              (-5.0, 1.0), ("IL", "SL"), (250.0, 5.0), (0.0, 305.0), (2250.0, 2450.0), (0, 0, 0, 2, 4, 6, 6, 6),
              open_mm={"teeth": 1.5}),
    "e": Goal({"GGp": 1.4, "GGh": 0.4, "TRANSm": 0.7}, 1.0, (0.0, 4.0), ("STY", "IL"), (200.0, 8.0), (390.0, 470.0),
              (1900.0, 2200.0), open_mm={"teeth": 3.0}),
    "a": Goal({"HG": 5.0, "STY": 1.1, "GGm": 0.3}, 7.0, (4.0, 12.0), ("VERTm", "PG"), (450.0, 10.0), (715.0, 845.0),
              (1120.0, 1230.0), open_mm={"teeth": 5.0, "soft palate": 3.5}),
    "o": Goal({"HG": 8.0, "STY": 1.5, "TRANSm": 0.3, "IL": 0.3}, 2.0, (1.0, 7.0), ("GGa",), (60.0, 12.0), (500.0, 600.0),
              (780.0, 920.0), open_mm={"teeth": 5.0, "soft palate": 2.5}),
    "u": Goal({"GGp": 2.1, "IL": 0.9, "STY": 2.1, "TRANSm": 0.5, "TRANSa": 0.2, "HG": 0.5}, -0.5, (-3.0, 2.0), ("MH", "PG"),
              (28.0, 20.0), (0.0, 340.0), (650.0, 890.0), (0, 0, 0, 0, 0, 0, 2, 4), open_mm={"teeth": 6.0}),
    "t": Goal({"GGm": 2.9, "GGp": 0.8, "GGh": 0.4, "TRANSm": 4.2, "VERTa": 1.2}, -2.0, (-5.0, 0.0), ("SL", "MH", "TRANSa", "PG"),
              rows=(0, 1), sides_mm=(16.0, 60.0), open_mm={"soft palate": 4.0}),
    "k": Goal({"STY": 2.1, "TRANSm": 3.8, "TRANSp": 0.9, "GGp": 1.3, "MH": 2.4, "PG": 0.6}, -2.3, (-4.0, 4.0),
              ("TRANSa", "GGm", "VERTa"), rows=(7,), sides_mm=(60.0, 75.0), open_mm={"teeth": 4.0}),
}  # fmt: skip


class Roof:
    """What is measured on the palate of a mouth."""

    def __init__(self, mouth: Mouth) -> None:
        self.mouth, self.palate = mouth, corners_of(mouth.palate.points, mouth.palate.triangles)
        line = palate_midline(self.palate, 0.0)
        at = None if line is None else electrodes(line, self.palate, 0.0, HARD_PALATE_M)
        grid = roof_grid(self.palate, 0.0)
        assert at is not None and grid is not None
        self.at: Electrodes = at
        self.grid: RoofGrid = grid
        self.points = grid.points.at(self.palate)
        self.samples: OnTriangles = surface_samples(surface_triangles(mouth.mesh, mouth.mesh.points)[0])

    def electrode_gaps_mm(self, settled: Settled) -> np.ndarray:
        """Signed distances (62,) of the electrodes from the tongue."""
        return 1e3 * clearance(self.at.position, self._tongue(settled), self.samples, SAMPLES_TRIED)[0]

    def leak(self, settled: Settled) -> tuple[Leak, np.ndarray]:
        """The leak, and the smallest gap of each row of the grid outside of a third of its width, mm."""
        gaps = gaps_below(self.points, self._tongue(settled), self.samples, self.grid.to_border)
        by_row = 1e3 * gaps.reshape(self.grid.side.shape)
        middle = by_row.shape[1] // 2
        return leak_in(self.grid, self.points, gaps), by_row[:, middle + middle // 3 :].min(axis=1)

    def _tongue(self, settled: Settled) -> np.ndarray:
        return surface_triangles(self.mouth.mesh, self.mouth.mesh.points + settled.displacement)[0]


@lru_cache(maxsize=2)
def roof_of(mesh: str) -> Roof:
    """The mouth of a resolution and its roof, once in each process."""
    return Roof(Mouth(mesh))


def beyond(value: float, band: tuple[float, float]) -> float:
    return max(value - band[1], 0.0) - max(band[0] - value, 0.0)


def posture_of(sound: str, unknowns: np.ndarray) -> Posture:
    """A posture from the forces in N of the muscles of a sound, and the opening."""
    names = [*GOALS[sound].start, *GOALS[sound].more]
    forces_N = {name: float(force) for name, force in zip(names, unknowns, strict=False) if force > 0.0}
    rise_ms, end_ms = (80.0, 140.0) if GOALS[sound].rows else (50.0, 200.0)
    return Posture(forces_N, float(unknowns[-1]), rise_ms, end_ms)


def loss(task: tuple[str, str, np.ndarray]) -> float:
    """Sum of squares of a posture: sound, mesh, unknowns."""
    sound, mesh, unknowns = task
    if mesh == "both":
        return loss((sound, "medium", unknowns)) + loss((sound, "fine", unknowns))
    goal, roof = GOALS[sound], roof_of(mesh)
    posture = posture_of(sound, unknowns)
    settled = roof.mouth.settle(posture)
    if settled.status != "finished":
        return REFUSED
    off: list[float] = [REFUSED * (settled.folded > 0), max(0.0, settled.hourglass_share - HOURGLASS_SHARE) / 0.01]
    off += [beyond(settled.gap_mm[region], (least, np.inf)) for region, least in goal.open_mm.items()]
    off += [1.5 * force / roof.mouth.maxima_N[name] for name, force in posture.forces_N.items()]
    gaps = roof.electrode_gaps_mm(settled)
    if goal.touched is not None:
        half = np.array(goal.touched)[roof.at.row] // 2
        wanted = (roof.at.column < half) | (roof.at.column >= ELECTRODE_COLUMNS - half)
        missed = np.minimum(1.2 * np.maximum(0.0, gaps - 0.3), 2.5)
        off += np.where(wanted, missed, 0.35 * np.maximum(0.0, 0.9 - gaps)).tolist()
    if goal.lips is not None:
        air = roof.mouth.air(posture, settled, goal.lips)
        off += [4.0, 4.0] if air is None else [beyond(air.F1, goal.F1) / 20.0, beyond(air.F2, goal.F2) / 60.0]
    if goal.rows:
        leak, sides = roof.leak(settled)
        row = min(goal.rows, key=lambda number: gaps[roof.at.row == number].max())
        along = (1e3 * roof.grid.place >= goal.sides_mm[0]) & (1e3 * roof.grid.place <= goal.sides_mm[1])
        off += [4.0 * max(0.0, 1e3 * leak.width_m - 0.12), beyond(settled.peak_kPa, goal.kPa) / 0.3]
        off += (2.0 * np.maximum(0.0, gaps[roof.at.row == row] - 0.2)).tolist()
        off += (0.7 * np.maximum(0.0, sides[along] - 0.2)).tolist()
    return float(np.square(off).sum())


def search(sound: str, mesh: str, seconds: float, seed: int, pool: ProcessPoolExecutor) -> tuple[float, Posture]:
    """The best posture that is found in a time, and its sum of squares."""
    goal, generator = GOALS[sound], np.random.default_rng(seed)
    maxima_N = roof_of("coarse").mouth.maxima_N
    most = LARGEST_SHARE * np.array([maxima_N[name] for name in (*goal.start, *goal.more)])
    start = np.array([*goal.start.values(), *(0.0 for _ in goal.more), goal.jaw_mm])
    best = [(next(iter(pool.map(loss, [(sound, mesh, start)]))), start)]
    spread, until = 0.18, time.monotonic() + seconds
    while time.monotonic() < until:
        tried = []
        for _ in range(CANDIDATES):
            one = best[min(len(best) - 1, int(generator.exponential(0.8)))][1].copy()
            forces = one[:-1] * np.exp(spread * generator.normal(size=len(most)))
            forces += (generator.random(len(most)) < 0.12) * generator.uniform(0.0, 0.08 * most)
            forces[generator.random(len(most)) < 0.04] = 0.0
            one[:-1] = np.clip(forces, 0.0, most)
            one[-1] = np.clip(one[-1] + JAW_STEP_MM * generator.normal(), *goal.bounds_mm)
            tried.append(one)
        best += zip(pool.map(loss, [(sound, mesh, one) for one in tried]), tried, strict=True)
        best = sorted(best, key=lambda pair: pair[0])[:KEPT]
        spread = max(0.06, 0.99 * spread)
    posture = posture_of(sound, best[0][1])
    rounded = {name: float(f"{force:.2g}") for name, force in posture.forces_N.items() if force > 0.02}
    return best[0][0], Posture(rounded, round(2.0 * posture.opening_mm) / 2.0, posture.rise_ms, posture.duration_ms)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("sounds", nargs="*", default=list(GOALS))
    parser.add_argument("--mesh", default="medium", help="coarse, medium, fine or both (medium and fine)")
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, default=ROOT / "outputs" / "postures")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(arguments.processes) as pool:
        for sound in arguments.sounds:
            value, posture = search(sound, arguments.mesh, arguments.seconds, arguments.seed, pool)
            print(f"[{sound}] sum of squares {value:.2f}: {posture.forces_N} N, jaw {posture.opening_mm} mm", flush=True)
            answer = {"sound": sound, "loss": value, "forces_N": posture.forces_N, "opening_mm": posture.opening_mm}
            (arguments.out / f"{sound}.json").write_text(json.dumps(answer, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
