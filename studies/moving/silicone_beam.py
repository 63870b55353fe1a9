"""A silicone cantilever in motion: what its model lacks, and how well the final model predicts curves that were held out.

    python -m studies.moving.silicone_beam [--data ../shared/data/measured/silicone-beam] [--held-out CURVE ...] [--hanging]

With --hanging the scenario states the load as a mass on a string, and as a force without inertia otherwise.

Each curve is held out in turn, or nothing. The others are fitted three times: elastic with the stiffness alone, with stiffness
and damping, and by close-loop. A residual model without names, a small network that corrects the acceleration, is trained on the
same curves. The table and the causes that were found are printed.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from explicitfe.inverse.close_loop.close import find_causes
from explicitfe.inverse.close_loop.report import LoopDocuments
from explicitfe.results.documents.loop_report import Estimate
from explicitfe.results.documents.motion_report import MovingMarkers
from studies.moving.residual_model import predict_with_residual

DATA = Path(__file__).parents[3] / "shared" / "data" / "measured" / "silicone-beam"
# Marker centres in the frame of the scenario [mm] (PROVENANCE.md, moved by 100 mm along x), and whether they sit on the clamp.
MARKERS = {
    "m0": ((100.0, 15.0, 36.0), False),
    "m1": ((100.0, -6.0, 24.0), False),
    "m2": ((100.0, 36.0, 6.0), False),
    "m3": ((6.0, -10.0, -1.0), True),
    "m4": ((6.0, 40.0, 27.5), True),
    "m5": ((6.0, 40.0, 0.0), True),
}
# Curve -> load [N], and the last row that is used [s]: 1.5 s after the release.
CURVES = {"gravity-a": (0.0, 2.2), "gravity-b": (0.0, 2.15), "load52-a": (0.51012, 1.95)}
G_M_S2 = 9.80709  # of the authors
NOTHING = "nothing"  # is held out
SCENARIO = """title = "Soft cantilever released under its own weight"
[model]
box_mm = [100.0, 30.0, 30.0]
cells = [13, 4, 4]
fixed = ["x0"]
material = { law = "neo-hooke", C10_Pa = 43970.7, poisson = 0.499, density_kg_m3 = 1070.0 }
gravity_m_s2 = [0.0, 0.0, -9.80709]
[analysis]
duration_ms = 2000.0
"""


def write_dataset(folder: Path, data: Path, held_out: str, fitted: Sequence[str], hanging: bool) -> None:
    """The folder of a dataset with one split; ``fitted`` are the constants of the baseline, ``hanging`` says what the load is."""
    folder.mkdir(parents=True)
    (folder / "scenario.toml").write_text(SCENARIO, encoding="utf-8")
    lines = [
        'format = "explicitfe-dataset/1"', 'name = "silicone-beam"', 'title = "Silicone cantilever released from straight"',
        'test = "trajectory"', 'source = "Dubied et al. (2022) IEEE RA-L"', 'scenario = "scenario.toml"',
        f"fit = {json.dumps(list(fitted))}",
    ]  # fmt: skip
    for name, (place, fixed) in MARKERS.items():
        lines += ["", "[[sensor]]", f'name = "{name}"', f"at_mm = {list(place)}", *(["fixed = true"] if fixed else [])]
    for name, (load, until) in CURVES.items():
        shutil.copy(data / f"{name}.csv", folder)
        side = "holdout" if name == held_out else "fit"
        lines += ["", "[[curve]]", f'id = "{name}"', f'file = "{name}.csv"', 'start_s = "fit"', f"until_s = {until}"]
        lines += [f'split = "{side}"', f"conditions.load_N = {load}"]
        if load:
            what = f"mass_g={1e3 * load / G_M_S2}, string_slack_mm=0.0" if hanging else f"force_N=[0.0,0.0,{-load}]"
            lines.append(f"""conditions.settings = ['load.+={{nodes=["x1","z1"], {what}}}']""")
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def errors_mm(one: MovingMarkers, path: np.ndarray) -> tuple[float, list[float]]:
    """Rms of the vertical coordinate of marker 0, and rms distance of each marker [mm]."""
    left = path - one.measured
    return float(np.sqrt(np.mean(left[:, 0, 2] ** 2))), [
        float(np.sqrt(np.mean(np.sum(d**2, axis=1)))) for d in left.swapaxes(0, 1)
    ]


def row(
    split: str, model: str, documents: LoopDocuments, seconds: float, paths: dict[str, np.ndarray] | None = None
) -> list[str]:
    rows = []
    for one in documents.markers:
        path = one.after if paths is None else paths[one.curve]
        vertical, markers = errors_mm(one, path)
        side = "**held out**" if one.split == "holdout" else "fitted"
        distances = ", ".join(f"{x:.2f}" for x in markers)
        rows.append(f"| {split} | {model} | {one.curve}, {side} | {vertical:.2f} | {distances} | {seconds:.0f} |")
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--held-out", nargs="*", default=[*CURVES, NOTHING], choices=[*CURVES, NOTHING])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--hanging", action="store_true")
    options = parser.parse_args()
    table = ["| held out | model | curve | marker 0, vertical (mm) | markers 0, 1, 2 (mm) | s |", "|---|---|---|---|---|---|"]
    found = []
    for split in options.held_out:
        for model, fitted, most in (
            ("elastic", ["stiffness"], 0),
            ("E and damping", ["stiffness", "damping"], 0),
            ("close-loop", ["stiffness"], 3),
        ):
            with tempfile.TemporaryDirectory() as folder:
                data = Path(folder) / "data"
                write_dataset(data, options.data, split, fitted, options.hanging)
                begin = time.perf_counter()
                documents = find_causes(data, max_effects=most, minutes=options.minutes, processes=2)
                seconds = time.perf_counter() - begin
            table += row(split, model, documents, seconds)
            if model == "E and damping":
                begin = time.perf_counter()
                paths = predict_with_residual(documents.markers, {name: load for name, (load, _) in CURVES.items()})
                table += row(split, "E, damping and a network", documents, time.perf_counter() - begin, paths)
            if most:
                report = documents.report
                values = {name: (e.value, e.ci95) for name, e in report.final.parameters.items() if isinstance(e, Estimate)}
                found.append(f"{split}: {report.verdict} {report.effects or report.nearest}, sure {report.sure}; {values}")
                found += [f"   {name}: {p:.3f}" for name, p in list(report.posterior.items())[:4]]
            print("\n".join(table[-6:]), flush=True)
    print("\n".join([*table, "", *found]))


if __name__ == "__main__":
    main()
