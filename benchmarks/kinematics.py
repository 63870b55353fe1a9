"""How far, how long and how fast simulated and measured tongues move: the tables and the picture of docs/kinematics.md.

    python benchmarks/kinematics.py [--out DIR] [--picture docs/pictures/kinematics.png] [SCENARIO ...]

Runs five gestures, each with its forces rising and falling within 30 to 100 ms, and the scenarios that are named, as they
are; a result that lies in DIR already is read instead. Measured: the articulography of two speakers (``tongue-ema-haskins``, see
tests/outside_data.py for where it is looked for). All strokes come from one detector, explicitfe/measure/strokes.py.
"""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from explicitfe.measure.sections import X, Z
from explicitfe.measure.strokes import Stroke, strokes
from explicitfe.measured.read import read_dataset
from explicitfe.results import open_result
from explicitfe.run.run import run
from explicitfe.view.palette import COLOURS, new_figure, plain, save

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from outside_data import SHARED_DATA  # noqa: E402

MEASURED = SHARED_DATA / "measured" / "tongue-ema-haskins"
GESTURES = ("vowel-i", "sl-alone", "sty-alone", "gga-alone", "hg-alone")
RAMPS_MS = (30.0, 50.0, 80.0, 100.0)
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
    "strokes", "number", "displacement, mm", "duration, ms", "peak speed, mm/s", "peak over mean speed", "when fastest, share",
    "peak speed over displacement, 1/s",
)  # fmt: skip


def gesture(name: str, ramp_ms: float, folder: Path) -> Path:
    """A scenario whose muscles rise, hold and fall, with ramps of this length: written into a folder."""
    table = tomllib.loads((ROOT / "scenarios" / f"{name}.toml").read_text(encoding="utf-8"))
    ends = [0.0, ramp_ms, ramp_ms + HOLD_MS, 2.0 * ramp_ms + HOLD_MS]
    pulls = [list(pair) for pair in zip(ends, (0.0, 1.0, 1.0, 0.0), strict=True)]
    table["title"] = f"{name}, ramps of {ramp_ms:g} ms"
    table["muscle"] = [
        {key: muscle[key] for key in ("name", "force_N", "distribution")} | {"profile": "table", "table": pulls}
        for muscle in table["muscle"]
    ]
    table["analysis"] |= {"duration_ms": ends[-1] + AFTERWARDS_MS}
    table["record"] = {"every_ms": 1e3 * STEP_S, "fields": ["displacement"]}
    path = folder / f"{name}-{ramp_ms:.0f}ms.json"
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


def draw(target: Path, by_ramp: dict[str, list[Stroke]], speakers: Sequence[Stroke]) -> None:
    """The picture: peak speed and duration against displacement."""
    figure = new_figure(10.0, 4.6)
    distance, duration, speed, *_ = columns(speakers)
    for axes, values, index, label in zip(
        figure.subplots(1, 2), (speed, duration), (2, 1), ("peak speed (mm/s)", "duration (ms)"), strict=True
    ):
        plain(axes)
        band(axes, distance, values)
        for (name, some), colour, marker in zip(by_ramp.items(), COLOURS, "o^sDvP", strict=False):
            figures = columns(some)
            axes.plot(
                figures[0], figures[index], marker, color=colour, ms=5, mec="white", mew=0.5, ls="", label=f"simulated, {name}"
            )
        axes.set_xlim(0.0, BINS_MM[-1])
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel("displacement of a stroke (mm)")
        axes.set_ylabel(label)
    figure.axes[0].legend(loc="upper left", frameon=False, fontsize=8.5)
    figure.suptitle("Strokes of the tongue: tip, blade, front and dorsum, simulated and measured", fontsize=12, fontweight="bold")
    save(figure, target)


def main() -> None:
    """Print the tables, and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", nargs="*", type=Path, help="scenarios that are run as they are")
    parser.add_argument("--out", type=Path, default=ROOT / "outputs" / "kinematics")
    parser.add_argument("--picture", type=Path, default=ROOT / "docs" / "pictures" / "kinematics.png")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)

    by_ramp: dict[str, list[Stroke]] = {}
    lines: list[str] = []
    for ramp_ms in RAMPS_MS:
        of_gesture = {name: simulated(result_of(gesture(name, ramp_ms, arguments.out), arguments.out)) for name in GESTURES}
        by_ramp[f"ramps of {ramp_ms:g} ms"] = [stroke for some in of_gesture.values() for stroke in some]
        lines += [row(f"`{name}`, {ramp_ms:g} ms", some) for name, some in of_gesture.items() if some]
    for scenario in arguments.scenario:
        some = simulated(result_of(scenario, arguments.out))
        if some:
            by_ramp[scenario.stem] = some
    speakers = measured()
    print(f"| {' | '.join(HEADINGS)} |")
    print(f"|{len(HEADINGS) * '---|'}")
    everything = [stroke for some in speakers.values() for stroke in some]
    print(row("two speakers, all three sensors", everything))
    for name, some in speakers.items():
        print(row(f"{SENSORS[name]} ({name})", some))
    print(row("against the jaw's sensor", [stroke for some in measured(from_jaw=True).values() for stroke in some]))
    print(row("between minima of speed", [stroke for some in measured(edge_share=0.0).values() for stroke in some]))
    for name, some in by_ramp.items():
        print(row(f"simulated, {name}", some))
    print("\n".join(lines))
    draw(arguments.picture, by_ramp, everything)


if __name__ == "__main__":
    main()
