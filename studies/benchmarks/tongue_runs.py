"""Every scenario of the tongue on both tissues, and the [i] of Gérard et al. (2005): the tables of docs/studies/tongue-runs.md.

    python studies/benchmarks/tongue_runs.py [--real FOLDER] [--out docs/studies/tongue-runs.md]

Runs the scenarios as they are and on the tissue of the cadaver; and ``vowel-i-gerard-2005`` on the coarse and the medium mesh,
with three distributions of force and both tissues; with ``--real FOLDER`` (see real_tongue.py) also on the measured mesh.
"""

from __future__ import annotations

import argparse
import datetime
import tempfile
from itertools import product
from pathlib import Path
from typing import Any

from real_tongue import write_model, write_scenario

from explicitfe.fem.mesh.validity import certify
from explicitfe.results.files import open_result
from explicitfe.results.measure.document import Measures
from explicitfe.results.measure.measure import measures_of
from explicitfe.results.measure.steps import last_step
from explicitfe.simulate.run.run import run

ROOT = Path(__file__).resolve().parents[2]
SCENARIOS = (
    "vowel-i", "vowel-i-braced", "ggp-alone", "gga-alone", "sl-alone", "ggm-alone", "ggh-alone", "il-alone", "sty-alone",
    "hg-alone", "pg-alone", "vert-alone", "trans-alone", "gh-alone", "mh-alone",
)  # fmt: skip
OF_THE_PAPER = "vowel-i-gerard-2005"
TISSUES = {"in vivo": "buchaillard-2009", "cadaver": "gerard-2005"}
DISTRIBUTIONS = ("ends", "along", "volume")
BRANCH = "{ alpha_per_s = 40.0, beta_s = 0.03"
PRONY = "effects.viscoelastic={g=[0.3, 0.3], tau_s=[0.02, 1.0]}"
DAMPINGS = {
    "alpha only": ("model.damping={ alpha_per_s = 40.0 }",),
    "beta 0.03 s, branch of 5 ms": (f"model.damping={BRANCH} }}",),
    "beta 0.03 s, branch of 2 ms": (f"model.damping={BRANCH}, tau_ms = 2.0 }}",),
    "Prony, g = 0.3 and 0.3, tau = 0.02 and 1 s": ("model.damping={ alpha_per_s = 40.0 }", PRONY),
}
POINTS, POINTS_OF_THE_PAPER = ("tip", "blade", "front", "dorsum", "back"), ("tip", "dorsum", "root")


def numbers(summary: dict[str, Any]) -> tuple[Measures, int]:
    """What a run came to at its end, and the number of its elements that are folded."""
    with open_result(summary["result"]) as result:
        certificate = certify(result.mesh.points + result.displacement(), result.mesh.hexes)
        return measures_of(result, last_step(result)), certificate.folded_count


def end_of(summary: dict[str, Any], folded: int) -> list[str]:
    """The cells that both tables end with."""
    return [
        f"{summary['largest_speed_mm_s']:.0f}",
        "yes" if summary["settled"] else "no",
        f"{100 * summary['hourglass_share']:.0f}",
        str(folded),
        f"{summary['energy_balance_error']:.0e}",
        str(summary["steps"]),
    ]


def head(cells: list[str]) -> str:
    """The head of a table."""
    return f"| {' | '.join(cells)} |\n|{'---|' * len(cells)}"


def moved(measures: Measures, points: tuple[str, ...]) -> list[str]:
    """Where points have moved."""
    return [f"{in_tenths(measures.points[name].forward_mm)}, {in_tenths(measures.points[name].up_mm)}" for name in points]


def in_tenths(mm: float) -> str:
    """A displacement with its sign, +0.0 for what rounds to nothing."""
    return f"{round(mm, 1) + 0.0:+.1f}"


def touched(measures: Measures, bone: str) -> str:
    """Area and force of the contact with a bone."""
    contact = measures.contact[bone]
    return f"{contact.area_mm2:.0f}, {contact.force_N:.2f}" if contact.area_mm2 else "-"


def row(name: str, tissue: str, summary: dict[str, Any]) -> str:
    """A scenario with bones."""
    measures, folded = numbers(summary)
    grooves = " / ".join(f"{groove.depth_mm:.1f}" for groove in measures.grooves.values())
    contacts = [touched(measures, bone) for bone in ("palate", "jaw")]
    return f"| {' | '.join([name, tissue, *moved(measures, POINTS), grooves, *contacts, *end_of(summary, folded)])} |"


def row_of_the_paper(mesh: str, tissue: str, distribution: str, summary: dict[str, Any]) -> str:
    """A run without bones."""
    measures, folded = numbers(summary)
    groove = f"{measures.grooves['front'].depth_mm:.1f}"
    cells = [mesh, tissue, distribution, *moved(measures, POINTS_OF_THE_PAPER), groove, *end_of(summary, folded)]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--real", type=Path, help="folder of the measured mesh")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "studies" / "tongue-runs.md")
    arguments = parser.parse_args()
    end = ["fastest node", "at rest", "hourglass", "inverted elements", "balance", "steps"]
    rows = [head(["run", "tissue", *POINTS, "groove", "palate", "jaw", *end])]
    damped = [head(["run", "tissue", "damping", *POINTS_OF_THE_PAPER, "groove", *end])]
    of_the_paper = [head(["mesh", "tissue", "distribution", *POINTS_OF_THE_PAPER, "groove", *end])]
    with tempfile.TemporaryDirectory() as folder:
        for (tissue, material), name in product(TISSUES.items(), SCENARIOS):
            path = ROOT / "scenarios" / f"{name}.toml"
            summary = run(path, folder, settings=[f"model.material={material}"], overwrite=True)
            rows.append(row(name, tissue, summary))
            print(rows[-1], flush=True)
        for name, (tissue, material), (label, settings) in product(("vowel-i", OF_THE_PAPER), TISSUES.items(), DAMPINGS.items()):
            path = ROOT / "scenarios" / f"{name}.toml"
            summary = run(path, folder, settings=[f"model.material={material}", *settings], overwrite=True)
            damped.append(row_of_the_paper(name, tissue, label, summary))
            print(damped[-1], flush=True)
        path = ROOT / "scenarios" / f"{OF_THE_PAPER}.toml"
        for mesh, (tissue, material), distribution in product(("coarse", "medium"), TISSUES.items(), DISTRIBUTIONS):
            settings = [f"model.resolution={mesh}", f"model.material={material}"]
            settings += [f"muscle.{muscle}.distribution={distribution}" for muscle in ("GGp", "GGh", "GGa")]
            summary = run(path, folder, settings=settings, overwrite=True)
            of_the_paper.append(row_of_the_paper(mesh, tissue, distribution, summary))
            print(of_the_paper[-1], flush=True)
        if arguments.real:
            write_model(arguments.real, Path(folder))
            for (tissue, material), distribution in product(TISSUES.items(), DISTRIBUTIONS):
                scenario = write_scenario(Path(folder), distribution)
                summary = run(scenario, folder, settings=[f"model.material={material}"], overwrite=True)
                of_the_paper.append(row_of_the_paper("measured", tissue, distribution, summary))
                print(of_the_paper[-1], flush=True)
    newline = "\n"
    text = f"""# Runs of the tongue

> *Study of {datetime.date.today():%Y-%m-%d}.* **In short.** Displacements, contact and solver figures of the scenarios
> of the tongue on two tissues, of the original setup of Gérard et al. (2005), and of other damping.

Written by `python studies/benchmarks/tongue_runs.py`. Displacements at the end of a run in mm as *forward, up*. Groove:
by how much more than at rest the midline of a coronal section lies below its sides, mm. Fastest node: at the end, mm/s.
At rest: at that speed no node would move by 5 % of the largest displacement in another 100 ms. Hourglass: largest share
of the elastic energy, %. Inverted elements: at the end. Balance: largest energy balance error. What the numbers mean:
[tongue.md](../reference/tongue.md).

## The scenarios

Medium mesh, muscles as stress, palate, jaw and pharynx. Groove at front / dorsum / back. Palate, jaw: area and normal
force sum of the contact, mm², N. *In vivo* is the tissue of the scenarios; *cadaver* is `model.material =
"gerard-2005"`, a fifth as stiff.

{newline.join(rows)}

## The [i] of Gérard et al. (2005)

`vowel-i-gerard-2005` after 120 ms: forces on nodes in steps, no bones, damping by alpha alone; groove at the front.

{newline.join(of_the_paper)}

## Damping

Medium mesh; groove at the front. Alpha is 40 1/s throughout.

{newline.join(damped)}
"""
    arguments.out.write_text(text, encoding="utf-8")
    print(f"written: {arguments.out}")


if __name__ == "__main__":
    main()
