"""Every gesture on every mesh, distribution and tissue: the table of docs/tongue-runs.md.

    python benchmarks/tongue_runs.py [--real FOLDER] [--out docs/tongue-runs.md]

Runs vowel [i], GGp alone, GGa alone and SL alone on the coarse and the medium tongue, with the three distributions of muscle
force and both tissues, 120 ms each. With ``--real FOLDER`` (see real_tongue.py) also vowel [i] on the measured mesh.
"""

from __future__ import annotations

import argparse
import tempfile
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from real_tongue import write_model, write_scenario

from explicitfe.measure.sections import groove_depth, section, station
from explicitfe.mesh.quality import corner_jacobians
from explicitfe.results import open_result
from explicitfe.run.run import run

ROOT = Path(__file__).resolve().parents[1]
SCENARIOS = ("vowel-i", "ggp-alone", "gga-alone", "sl-alone")
MUSCLES = {"vowel-i": ("GGp", "GGa"), "ggp-alone": ("GGp",), "gga-alone": ("GGa",), "sl-alone": ("SL",)}
MATERIALS = ("gerard-2005", "buchaillard-2009")
DISTRIBUTIONS = ("ends", "along", "volume")
HEAD = (
    "| run | mesh | tissue | distribution | status | tip | dorsum | root | groove | fastest | settled | min J | hourglass"
    " | folded | balance | steps |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|"
)


def row(name: str, mesh: str, material: str, distribution: str, summary: dict[str, Any]) -> str:
    """One row of the table."""
    with open_result(summary["result"]) as result:
        reference, u = result.mesh, result.displacement()
        folded = int(np.sum(np.any(corner_jacobians(reference.points + u, reference.hexes) <= 0.0, axis=1)))
        cut = section(reference, 0, station(reference, "front"))
        groove = 1e3 * groove_depth(cut.at(reference.points), cut.at(reference.points + u))
    points = []
    for point in ("tip", "dorsum", "root"):
        x, _, z = summary["probes"][point]["displacement_mm"]
        points.append(f"{-x:+.1f}, {z:+.1f}")
    cells = [
        name, mesh, material, distribution, summary["status"], *points, f"{groove:.1f}",
        f"{summary['largest_speed_mm_s']:.0f}", "yes" if summary["settled"] else "no", f"{summary['min_J']:.3f}",
        f"{100 * summary['hourglass_share']:.0f} / {100 * summary['hourglass_share_end']:.0f}", str(folded),
        f"{summary['energy_balance_error']:.0e}", str(summary["steps"]),
    ]  # fmt: skip
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--real", type=Path, help="folder of the measured mesh")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "tongue-runs.md")
    arguments = parser.parse_args()
    rows = [HEAD]
    with tempfile.TemporaryDirectory() as folder:
        for name, material, mesh, distribution in product(SCENARIOS, MATERIALS, ("coarse", "medium"), DISTRIBUTIONS):
            settings = [f"model.resolution={mesh}", f"model.material={material}"]
            settings += [f"muscle.{muscle}.distribution={distribution}" for muscle in MUSCLES[name]]
            summary = run(ROOT / "scenarios" / f"{name}.toml", folder, settings=settings, overwrite=True)
            rows.append(row(name, mesh, material, distribution, summary))
            print(rows[-1], flush=True)
        if arguments.real:
            write_model(arguments.real, Path(folder))
            for material, distribution in product(MATERIALS, DISTRIBUTIONS):
                scenario = write_scenario(Path(folder), distribution)
                summary = run(scenario, folder, settings=[f"model.material={material}"], overwrite=True)
                rows.append(row("vowel-i", "measured", material, distribution, summary))
                print(rows[-1], flush=True)
    text = f"""# Runs of the tongue: 120 ms of each gesture

Made by `python benchmarks/tongue_runs.py`. Displacements at 120 ms in mm as *forward, up*; groove: how far the midline of the
front coronal section lies below its sides, mm; fastest: the fastest node at 120 ms, mm/s; settled: at that speed no node
would move by 5 % of the largest displacement in another 100 ms; min J: smallest J of any element in any step; hourglass:
share of the elastic energy, largest over the run / at the end, %; folded: elements with an inverted corner at the end (J at
the integration point stays positive there); balance: largest energy balance error. What it means: [tongue.md](tongue.md).

{chr(10).join(rows)}
"""
    arguments.out.write_text(text)
    print(f"written: {arguments.out}")


if __name__ == "__main__":
    main()
