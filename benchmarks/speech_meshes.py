"""What mesh density does to the headline figures of the speech scenarios: the tables of docs/speech-meshes.md.

    python benchmarks/speech_meshes.py OUT [--only vowel-i ...] [--real FOLDER] [--page docs/speech-meshes.md]

Every scenario on the coarse, the medium and the fine tongue; with ``--real FOLDER`` (see real_tongue.py) also on the measured
mesh, with the palate and the jaw of the built-in tongue. What was computed stays in OUT, so that a stopped study goes on.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from pathlib import Path
from typing import Any

from real_tongue import write_model
from tongue_cases import write_bones
from tongue_runs import head, in_tenths

import explicitfe
from explicitfe.measure.document import Measures
from explicitfe.measure.measure import measures_of
from explicitfe.measure.steps import last_step
from explicitfe.results import open_result
from explicitfe.scenario.read import read_scenario

ROOT = Path(__file__).resolve().parents[1]
SCENARIOS = ("vowel-i", "vowel-i-braced")
MESHES = ("coarse", "medium", "fine")
MEASURED = "measured"
# A point of the axis of the condyles, of models/tongue/bones.toml.
JAW_AXIS_mm = [136.0, 0.0, 138.0]


def settings_of(scenario: Path, mesh: str, folder: Path) -> list[str]:
    """What puts a scenario on a mesh; ``folder`` holds the model file and the bones of the measured one."""
    if mesh != MEASURED:
        return [f"model.resolution={mesh}"]
    tables = read_scenario(scenario)[0]
    bones = ", ".join(f'{{name="{bone.name}", file="{folder / bone.name}.stl", length_unit="mm"}}' for bone in tables.bone)
    settings = [f'model.file="{folder / "real-tongue.toml"}"', f"bone=[{bones}]"]
    return settings if tables.jaw is None else [*settings, f"jaw.axis_mm={JAW_AXIS_mm}"]


def compute(scenario: Path, mesh: str, folder: Path) -> dict[str, Any]:
    """Summary and measures of a scenario on a mesh, kept in ``folder``."""
    settings = settings_of(scenario, mesh, folder)
    digest = hashlib.sha256((scenario.read_text(encoding="utf-8") + repr(settings)).encode()).hexdigest()[:12]
    kept = folder / f"{scenario.stem}_{mesh}_{digest}.json"
    if kept.is_file():
        return json.loads(kept.read_text(encoding="utf-8"))
    summary = explicitfe.run(scenario, folder, settings=settings, overwrite=True)
    with open_result(Path(summary["result"])) as result:
        measures = measures_of(result, last_step(result)).model_dump()
    answer = {"summary": summary, "measures": measures}
    kept.write_text(json.dumps(answer, default=str), encoding="utf-8")
    return answer


def row(name: str, mesh: str, answer: dict[str, Any]) -> str:
    """What a scenario came to on a mesh."""
    summary, measures = answer["summary"], Measures.model_validate(answer["measures"])
    cells = [name, mesh]
    if summary["status"] != "finished":
        return f"| {' | '.join([*cells, summary['message']])} |"
    for point in ("tip", "front", "dorsum"):
        moved = measures.points[point]
        cells.append(f"{in_tenths(moved.forward_mm)}, {in_tenths(moved.up_mm)}")
    groove, nearest, palate = measures.grooves["front"], measures.constriction, measures.contact["palate"]
    cells.append(f"{groove.depth_mm:.1f}")
    cells.append("" if nearest is None else f"{nearest.width_mm:.1f} at {nearest.place_mm:.0f}")
    cells.append(f"{palate.area_mm2:.0f}, {palate.force_N:.2f}")
    cells += [
        f"{summary['largest_speed_mm_s']:.0f}",
        str(summary["folded"]["elements"]),
        f"{summary['energy_balance_error']:.0e}",
    ]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path, metavar="OUT")
    parser.add_argument("--only", nargs="*", default=SCENARIOS)
    parser.add_argument("--real", type=Path, help="folder of the measured mesh")
    parser.add_argument("--page", type=Path)
    arguments = parser.parse_args()
    folder = arguments.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    meshes = MESHES
    if arguments.real:
        write_model(arguments.real, folder, as_stress=True)
        write_bones(folder)
        meshes = (*MESHES, MEASURED)
    columns = ["scenario", "mesh", "tip", "front", "dorsum", "groove", "constriction", "palate", "fastest", "folded", "balance"]
    rows = [head(columns)]
    for name in arguments.only:
        for mesh in meshes:
            rows.append(row(name, mesh, compute(ROOT / "scenarios" / f"{name}.toml", mesh, folder)))
            print(rows[-1], flush=True)
    if arguments.page:
        page = arguments.page.read_text(encoding="utf-8")
        before, _, rest = page.partition("<!-- runs -->\n")
        _, _, after = rest.partition("<!-- end runs -->")
        arguments.page.write_text(
            f"{before}<!-- runs -->\n\n" + "\n".join(rows) + f"\n\n<!-- end runs -->{after}", encoding="utf-8"
        )


if __name__ == "__main__":
    main()
