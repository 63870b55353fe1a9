"""How far, how long and how fast simulated and measured tongues move: the tables and the picture of docs/studies/kinematics.md.

    python studies/benchmarks/kinematics.py [--out DIR] [--picture docs/pictures/kinematics.png] [SCENARIO ...]

Runs five gestures, each with its forces rising and falling within 30 to 100 ms or overshooting, and the scenarios that are
named, as they are; a result that lies in DIR already is read instead. Measured: the articulography of two speakers
(``tongue-ema-haskins``; tests/outside_data.py says where it is looked for). All strokes come from one detector,
explicitfe/results/measure/strokes.py.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import tomllib
from collections.abc import Iterable, Sequence
from itertools import pairwise, product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from explicitfe.app.view.palette import COLOURS, new_figure, plain, save
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.results.files import open_result
from explicitfe.results.measure.sections import X, Z
from explicitfe.results.measure.strokes import Stroke, strokes
from explicitfe.simulate.run.run import run

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))
from outside_data import SHARED_DATA  # noqa: E402

MEASURED = SHARED_DATA / "measured" / "tongue-ema-haskins"
GESTURES = ("vowel-i", "sl-alone", "sty-alone", "gga-alone", "hg-alone")
RAMPS_MS = (30.0, 50.0, 80.0, 100.0)
# Stiffness-proportional damping: that of the scenarios, and a third of it.
BETAS_S = (0.03, 0.01)
# Forces that overshoot rise to this share of what they hold, and are back at it so much later.
OVERSHOOT_SHARE, COMING_BACK_MS = 1.3, 40.0
OVERSHOOT_RAMPS_MS = (50.0, 80.0)
HOLD_MS, AFTERWARDS_MS = 150.0, 150.0
POINTS = ("tip", "blade", "front", "dorsum")
SENSORS = {"TT": "tip", "TB": "blade or body", "TR": "rear"}
JAW_SENSOR = "JAW"
# The same for both: what is faster than 20 Hz is filtered out, and a stroke begins and ends at a fifth of its peak speed.
CUTOFF_HZ, EDGE_SHARE = 20.0, 0.2
# Samples of simulations are taken at this distance before they are filtered, and the point stands still so long before.
STEP_S, STILL_S = 0.002, 0.1
# Quantiles that are shown, and the displacements between which strokes are put together.
QUANTILES = (0.1, 0.5, 0.9)
BINS_MM = np.array([1.0, 2.0, 4.0, 6.0, 8.0, 12.0])
HEADINGS = (
    "movements", "count", "displacement, mm", "duration, ms", "peak speed, mm/s", "peak over mean speed",
    "time of peak speed, share", "peak speed over displacement, 1/s",
)  # fmt: skip


class Course(NamedTuple):
    """How the forces of a gesture go, ``pulls`` being times in ms and shares of the force; and the damping of the tissue."""

    name: str
    beta_s: float
    ramp_ms: float
    pulls: list[list[float]]


def ramps(beta_s: float, ramp_ms: float) -> Course:
    """Forces that rise in a ramp, hold, and fall in a ramp."""
    end = 2.0 * ramp_ms + HOLD_MS
    pulls = [[0.0, 0.0], [ramp_ms, 1.0], [ramp_ms + HOLD_MS, 1.0], [end, 0.0]]
    return Course(f"beta {beta_s:g} s, ramps of {ramp_ms:g} ms", beta_s, ramp_ms, pulls)


def overshoot(beta_s: float, ramp_ms: float) -> Course:
    """Forces that rise in a ramp to more than what they hold, and come back to that."""
    pulls = [[0.0, 0.0], [ramp_ms, OVERSHOOT_SHARE], [ramp_ms + COMING_BACK_MS, 1.0], [ramp_ms + HOLD_MS, 1.0]]
    name = f"beta {beta_s:g} s, in {ramp_ms:g} ms to {OVERSHOOT_SHARE:g} times the force, and back"
    return Course(name, beta_s, ramp_ms, pulls)


def gesture(name: str, course: Course, folder: Path) -> Path:
    """A scenario whose muscles follow a course: written into a folder."""
    table = tomllib.loads((ROOT / "scenarios" / f"{name}.toml").read_text(encoding="utf-8"))
    table["title"] = f"{name}, {course.name}"
    table["model"]["damping"] |= {"beta_s": course.beta_s}
    table["muscle"] = [
        {key: muscle[key] for key in ("name", "force_N", "distribution")} | {"profile": "table", "table": course.pulls}
        for muscle in table["muscle"]
    ]
    if "jaw" in table:
        table["jaw"]["table"] = course.pulls
    table["analysis"] |= {"duration_ms": course.pulls[-1][0] + AFTERWARDS_MS}
    table["record"] = {"every_ms": 1e3 * STEP_S, "fields": ["displacement"]}
    path = folder / f"{name}-{re.sub('[^a-z0-9.]+', '-', course.name)}.json"
    path.write_text(json.dumps(table), encoding="utf-8")
    return path


def result_of(scenario: Path, folder: Path) -> Path:
    """The result of a scenario, computed unless it lies in the folder."""
    target = folder / f"{scenario.stem}.vtkhdf"
    if not target.exists():
        summary = run(scenario, folder)
        print(f"{scenario.stem}: {summary['status']}", file=sys.stderr)
    return target


def simulated(result_path: Path) -> list[Stroke]:
    """Strokes of the points of a result in the midsagittal plane."""
    every: list[Stroke] = []
    with open_result(result_path) as result:
        times = result.history("time")
        even = np.arange(-STILL_S, times[-1], STEP_S)
        for name in POINTS:
            u = result.history(f"probe_{name}_displacement")
            place = np.column_stack([np.interp(even, times, u[:, axis]) for axis in (X, Z)])
            every += strokes(even, place, cutoff_hz=CUTOFF_HZ, edge_share=EDGE_SHARE)
    return every


def measured(*, edge_share: float = EDGE_SHARE, from_jaw: bool = False) -> dict[str, list[Stroke]]:
    """Strokes of the speakers' sensors on the tongue, in the head's frame or as they move against the jaw's sensor."""
    every: dict[str, list[Stroke]] = {name: [] for name in SENSORS}
    for curve in read_dataset(MEASURED).curves:
        for name in SENSORS:
            place = curve.sensors[name] - (curve.sensors[JAW_SENSOR] if from_jaw else 0.0)
            every[name] += strokes(curve.time_s, place[:, [X, Z]], cutoff_hz=CUTOFF_HZ, edge_share=edge_share)
    return every


def columns(of: Iterable[Stroke]) -> np.ndarray:
    """Distance mm, duration ms, peak speed mm/s, peak over mean speed, and the peak's time as a share, of strokes: (5, n)."""
    rows = [(1e3 * s.distance_m, 1e3 * s.duration_s, 1e3 * s.peak_speed_m_s, s.peak_over_mean, s.peak_share) for s in of]
    return np.array(rows).reshape(-1, 5).T


def row(label: str, of: Sequence[Stroke]) -> str:
    """A row of the table: number of strokes, and the quantiles of their figures."""
    distance, duration, speed, ratio, share = columns(of)
    low_middle_high = [np.quantile(values, QUANTILES) for values in (distance, duration, speed, ratio, share)]
    cells = [f"{middle:.{digits}f} ({low:.{digits}f}-{high:.{digits}f})" for (low, middle, high), digits in
             zip(low_middle_high, (1, 0, 0, 2, 2), strict=True)]  # fmt: skip
    slope = float(distance @ speed / (distance @ distance))
    return f"| {label} | {len(of)} | {' | '.join(cells)} | {slope:.1f} |"


def band(axes: Axes, distance: np.ndarray, values: np.ndarray) -> None:
    """Draw the quantiles of measured values over bins of displacement: no single stroke, as the data state no licence."""
    inside = [(distance >= low) & (distance < high) for low, high in pairwise(BINS_MM)]
    at = [float(np.median(distance[some])) for some in inside]
    low, middle, high = np.array([np.quantile(values[some], QUANTILES) for some in inside]).T
    axes.fill_between(at, low, high, color="0.85", lw=0, label="two speakers, 10 to 90 %")
    axes.plot(at, middle, "-o", color="0.35", lw=1.8, ms=4, label="their median")


def draw(target: Path, groups: Sequence[tuple[Course, list[Stroke]]], speakers: Sequence[Stroke]) -> None:
    """The picture: speed and duration against displacement, of ramps with the first beta; and of all courses how they stand."""
    figure = new_figure(13.0, 4.7)
    of_speakers = columns(speakers)
    *over_distance, summary = figure.subplots(1, 3)
    for axes, index, label in zip(over_distance, (2, 1), ("peak speed (mm/s)", "duration (ms)"), strict=True):
        plain(axes)
        band(axes, of_speakers[0], of_speakers[index])
        for (course, some), colour, marker in zip(groups, COLOURS[: len(RAMPS_MS)], "o^sD", strict=False):
            figures = columns(some)
            label_of = f"simulated, ramps of {course.ramp_ms:g} ms"
            axes.plot(figures[0], figures[index], marker, color=colour, ms=5, mec="white", mew=0.5, ls="", label=label_of)
        axes.set_xlim(0.0, BINS_MM[-1])
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel("displacement of a stroke (mm)")
        axes.set_title(f"{label}, beta {BETAS_S[0]:g} s", fontsize=10.5)
    over_distance[0].legend(loc="upper left", frameon=False, fontsize=8.5)

    plain(summary)
    share, ratio = of_speakers[4], of_speakers[2] / of_speakers[0]
    (left, middle, right), (bottom, centre, top) = np.quantile(share, QUANTILES), np.quantile(ratio, QUANTILES)
    summary.errorbar(
        middle, centre, yerr=[[centre - bottom], [top - centre]], xerr=[[middle - left], [right - middle]], fmt="o", color="0.35",
        ecolor="0.7", elinewidth=8, ms=9, label="two speakers, median, 10 to 90 %",
    )  # fmt: skip
    series = {
        f"ramps, beta {BETAS_S[0]:g} s": (groups[: len(RAMPS_MS)], "-", COLOURS[0]),
        f"ramps, beta {BETAS_S[1]:g} s": (groups[len(RAMPS_MS) : 2 * len(RAMPS_MS)], "--", COLOURS[1]),
        f"to {OVERSHOOT_SHARE:g} times the force and back, beta {BETAS_S[0]:g} s": (groups[2 * len(RAMPS_MS) :], ":", COLOURS[2]),
    }
    for label, (some_groups, line, colour) in series.items():
        at = np.array([[np.median(columns(some)[4]), np.median(columns(some)[2] / columns(some)[0])] for _, some in some_groups])
        summary.plot(*at.T, "o", ls=line, color=colour, ms=5, lw=1.5, label=label)
        for (course, _), place in zip(some_groups, at, strict=True):
            summary.annotate(f"{course.ramp_ms:g} ms", place, (5, 4), textcoords="offset points", fontsize=8, color=colour)
    summary.set_xlim(0.25, 0.75)
    summary.set_ylim(0.0, 32.0)
    summary.set_xlabel("when a stroke is fastest (share of its duration)")
    summary.set_title("peak speed over displacement (1/s), medians", fontsize=10.5)
    summary.legend(loc="lower right", frameon=False, fontsize=8.5)
    figure.suptitle("Strokes of the tongue: tip, blade, front and dorsum, simulated and measured", fontsize=13, fontweight="bold")
    save(figure, target)


def main() -> None:
    """Print the tables, and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", nargs="*", type=Path, help="scenarios that are run as they are")
    parser.add_argument("--out", type=Path, default=ROOT / "outputs" / "kinematics")
    parser.add_argument("--picture", type=Path, default=ROOT / "docs" / "pictures" / "kinematics.png")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)

    courses = [ramps(beta_s, ramp_ms) for beta_s, ramp_ms in product(BETAS_S, RAMPS_MS)]
    courses += [overshoot(BETAS_S[0], ramp_ms) for ramp_ms in OVERSHOOT_RAMPS_MS]
    groups: list[tuple[Course, list[Stroke]]] = []
    lines: list[str] = []
    for course in courses:
        scenarios = {name: gesture(name, course, arguments.out) for name in GESTURES}
        of_gesture = {name: simulated(result_of(path, arguments.out)) for name, path in scenarios.items()}
        groups.append((course, [stroke for some in of_gesture.values() for stroke in some]))
        lines += [row(f"`{name}`, {course.name}", some) for name, some in of_gesture.items() if some]
    whole = {scenario.stem: simulated(result_of(scenario, arguments.out)) for scenario in arguments.scenario}
    speakers = measured()
    print(f"| {' | '.join(HEADINGS)} |")
    print(f"|{len(HEADINGS) * '---|'}")
    everything = [stroke for some in speakers.values() for stroke in some]
    print(row("two speakers, all three sensors", everything))
    for name, some in speakers.items():
        print(row(f"{SENSORS[name]} ({name})", some))
    print(row("against the jaw's sensor", [stroke for some in measured(from_jaw=True).values() for stroke in some]))
    print(row("between minima of speed", [stroke for some in measured(edge_share=0.0).values() for stroke in some]))
    for course, some in groups:
        print(row(course.name, some))
    for name, some in whole.items():
        print(row(f"`{name}`", some))
    print("\n".join(lines))
    draw(arguments.picture, groups, everything)


if __name__ == "__main__":
    main()
