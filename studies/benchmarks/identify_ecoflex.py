"""Constants of five silicone mixes from one casting each, against the other casting: a table and docs/pictures/ecoflex.png.

    python studies/benchmarks/identify_ecoflex.py DATASET [--picture docs/pictures/ecoflex.png]

DATASET is the folder of the compression tests of Dawood et al. (2026), in the format of docs/reference/identify.md.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from explicitfe.app.api.inverse import identify
from explicitfe.app.view import fit as fitfigures
from explicitfe.inverse.identify.forward import UniformResponse
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.inverse.predict.setup import setup_of

POISSON, REFINEMENT = 0.499, 1.5


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    result = identify(options.dataset, fit=["sample=A"], poisson=POISSON, refinement=REFINEMENT)
    print("| mix | C10 (Pa) | C20 (Pa) | nrmse fitted | nrmse predicted | first force (N) | sticking faces would make C10, C20 |")
    print("|---|---|---|---|---|---|---|")
    heads = {}
    for name, group in result["groups"].items():
        C10, C20 = (group["constants"][key]["value"] for key in ("C10_Pa", "C20_Pa"))
        fit, held = (100.0 * group["error"][side]["nrmse"] for side in ("fit", "holdout"))
        first = max((row["first_value"] for row in group["curves"].values()), key=abs)
        stick = group["hides"][0]
        heads[name] = f"{C10:.0f} and {C20:.0f} Pa; off by {fit:.1f} and {held:.1f} %"
        print(
            f"| {name} | {C10:.0f} | {C20:.0f} | {fit:.2f} % | {held:.2f} % | {first:+.3f} | "
            f"{100.0 * stick['C10_change']:+.0f} %, {100.0 * stick['C20_change']:+.0f} % |"
        )
    print(f"\n{result['forward_runs']} forward runs, {result['wall_s']:.0f} s")
    if options.picture is not None:
        panels: dict[str, list[dict]] = {name: [] for name in result["groups"]}
        for curve in read_dataset(options.dataset).curves:
            group = result["groups"][curve.constants]
            constants = [group["constants"][key]["value"] for key in ("C10_Pa", "C20_Pa")]
            response = UniformResponse(setup_of(curve, POISSON, REFINEMENT), POISSON)
            panels[curve.constants].append(
                {
                    "split": group["curves"][curve.id]["split"],
                    "x": 1e3 * curve.displacement_m,
                    "measured": curve.force_N,
                    "line_x": 1e3 * curve.displacement_m,
                    "line_y": response.at_depth(curve.displacement_m, *constants)[0],
                    "x_label": "displacement (mm)",
                    "y_label": "force (N)",
                }
            )
        fitfigures.materials(options.picture, panels, heads)


if __name__ == "__main__":
    main()
