"""Vowels, stops and the sequence of scenarios/ on a mesh of choice: the tables of docs/studies/speech.md.

    python studies/benchmarks/speech_runs.py [vowels sounds stops sequence jaw hyoid] [--mesh coarse | medium | fine | measured]

``measured`` is the mesh of ArtiSynth (real_tongue.py), which lies outside of the project.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tests"))

import numpy as np  # noqa: E402
from real_tongue import write_model  # noqa: E402
from tongue_cases import MEASURED, MEASURED_TONGUE, write_bones  # noqa: E402
from tongue_runs import head, in_tenths, moved  # noqa: E402

from explicitfe.results.files import Result, open_result  # noqa: E402
from explicitfe.results.measure.document import Measures  # noqa: E402
from explicitfe.results.measure.formants import airway  # noqa: E402
from explicitfe.results.measure.measure import measures_of  # noqa: E402
from explicitfe.results.measure.motion import has_settled  # noqa: E402
from explicitfe.results.measure.steps import step_at  # noqa: E402
from explicitfe.simulate.run.run import run  # noqa: E402

POINTS = ("tip", "blade", "front", "dorsum", "back")
VOWELS = ("vowel-i", "vowel-i-braced", "vowel-i-palatal", "vowel-e", "vowel-a", "vowel-u")
STOPS = ("alveolar-t", "alveolar-t-sl", "alveolar-t-sealed")
HELD_MS = 140.0  # when a stop is measured: before its release
VELUM_X_M = 115e-3  # where the velum begins, models/tongue/bones.toml
DWELLS_MS = {"i": 148.0, "a": 343.0, "u": 538.0}  # end of each in the sequence
VARIED = "vowel-a"  # in which jaw and hyoid bone move most


class Ran(NamedTuple):
    summary: dict[str, Any]
    path: Path

    def at(self, time_ms: float | None = None) -> Measures:
        with open_result(self.path) as result:
            return measures_of(result, step_at(result, None if time_ms is None else 1e-3 * time_ms))


def settings_of(mesh: str, folder: Path) -> list[str]:
    """The ``--set`` of a mesh."""
    if mesh != MEASURED:
        return [f"model.resolution={mesh}"]
    model = write_model(MEASURED_TONGUE, folder, as_stress=True).resolve()
    write_bones(folder)
    surfaces = ", ".join(
        f'{{name="{name}", file="{(folder / name).resolve()}.stl", length_unit="mm"}}' for name in ("palate", "jaw")
    )
    return [f'model.file="{model}"', f"bone=[{surfaces}]", "jaw.axis_mm=[136, 0, 138]", "jaw.incisor_mm=[53.5, 0, 95]"]


def ran(name: str, mesh: list[str], folder: Path, *settings: str) -> Ran:
    path = ROOT / "scenarios" / f"{name}.toml"
    if "[jaw]" not in path.read_text(encoding="utf-8"):
        mesh = [setting for setting in mesh if not setting.startswith("jaw.")]
    summary = run(path, folder, settings=[*mesh, *settings], overwrite=True)
    return Ran(summary, Path(summary["result"]))


def soundness(summary: dict[str, Any]) -> list[str]:
    """Whether a run may be believed: settled, folded elements, balance, warnings."""
    return [
        "yes" if summary["settled"] else "no",
        str(summary["folded"]["elements"]),
        f"{summary['energy_balance_error']:.0e}",
        str(len(summary["warnings"])),
    ]


END = ["at rest", "inverted elements", "balance", "warnings"]


def top(measures: Measures) -> str:
    assert measures.highest is not None
    return f"{in_tenths(measures.highest.forward_mm)}, {in_tenths(measures.highest.up_mm)}"


def contact(measures: Measures) -> str:
    palate = measures.contact["palate"]
    free = "free" if palate.midline_free else "touched"
    return f"{palate.area_mm2:.0f}, {palate.peak_kPa:.1f}, {free}" if palate.area_mm2 else "none"


def vowels(mesh: list[str], folder: Path) -> list[str]:
    rows = [head(["scenario", *POINTS, "highest point", "constriction: mm, at", "palate: mm², kPa, midline", *END])]
    for name in VOWELS:
        done = ran(name, mesh, folder)
        seen = done.at()
        narrow = seen.constriction
        place = "-" if narrow is None else f"{narrow.width_mm:.1f}, {narrow.place_mm:.0f}"
        cells = [*moved(seen, POINTS), top(seen), place, contact(seen), *soundness(done.summary)]
        rows.append(f"| `{name}` | {' | '.join(cells)} |")
    return rows


def velum_height_mm(result: Result, step: int) -> float:
    """How far the top of the tongue below the front of the velum has risen: the highest midline node within 8 mm of it."""
    mesh = result.mesh
    near = (np.abs(mesh.points[:, 1]) < 1e-3) & (np.abs(mesh.points[:, 0] - VELUM_X_M) < 8e-3)
    highest = np.flatnonzero(near)[mesh.points[near, 2].argmax()]
    return 1e3 * float(result.displacement(step)[highest, 2])


def stops(mesh: list[str], folder: Path) -> list[str]:
    columns = [
        "scenario",
        "tip",
        "dorsum",
        "back",
        "at the velum, up",
        "closed, ms",
        "peak kPa while closed",
        "constriction: mm, at",
    ]
    rows = [head([*columns, "palate: mm², kPa, midline", *END])]
    for name in STOPS:
        done = ran(name, mesh, folder)
        seen = done.at(HELD_MS)
        with open_result(done.path) as result:
            step = step_at(result, 1e-3 * HELD_MS)
            height = velum_height_mm(result, step)
            closed, pressures = closure(result)
        narrow = seen.constriction
        place = "-" if narrow is None else f"{narrow.width_mm:.1f}, {narrow.place_mm:.0f}"
        peak = f"{max(pressures):.1f}" if pressures else "-"
        cells = [*moved(seen, ("tip", "dorsum", "back")), f"{height:+.1f}", f"{closed:.0f}", peak, place, contact(seen)]
        rows.append(f"| `{name}` | {' | '.join([*cells, *soundness(done.summary)])} |")
    return rows


def closure(result: Result) -> tuple[float, list[float]]:
    """For how long a node within 3 mm of the midline touches the palate, ms, and the highest pressure then, kPa."""
    middle = np.abs(result.mesh.points[:, 1]) < 3e-3
    pressures = []
    for step in range(len(result.times)):
        pressure = result.field("contact_pressure_palate", step)
        if (pressure[middle] > 0.0).any():
            pressures.append(1e-3 * float(pressure.max()))
    every_ms = 1e3 * float(result.times[1] - result.times[0])
    return every_ms * len(pressures), pressures


def sequence(mesh: list[str], folder: Path) -> list[str]:
    done = ran("sequence-iau", mesh, folder)
    rows = [head(["at", *POINTS, "highest point", "constriction: mm, at", "fastest node, mm/s", "at rest"])]
    with open_result(done.path) as result:
        for sound, time_ms in (DWELLS_MS | {"end": 1e3 * float(result.times[-1])}).items():
            step = step_at(result, 1e-3 * time_ms)
            seen = measures_of(result, step)
            fastest = float(np.linalg.norm(result.field("velocity", step), axis=1).max())
            largest = max(float(np.linalg.norm(result.displacement(k), axis=1).max()) for k in range(0, len(result.times), 5))
            narrow = seen.constriction
            place = "-" if narrow is None else f"{narrow.width_mm:.1f}, {narrow.place_mm:.0f}"
            still = "yes" if has_settled(fastest, largest) else "no"
            where = f"[{sound}], {time_ms:.0f} ms" if sound in DWELLS_MS else "rest again"
            rows.append(f"| {where} | {' | '.join([*moved(seen, POINTS), top(seen), place, f'{1e3 * fastest:.0f}', still])} |")
        peaks = ", ".join(f"{name} {seen.points[name].peak_speed_mm_s:.0f}" for name in POINTS)
    rows += [
        "",
        f"Peak speeds, mm/s: {peaks}. " + ", ".join(map(": ".join, zip(END[1:], soundness(done.summary)[1:], strict=True))),
    ]
    return rows


def sounds(mesh: list[str], folder: Path) -> list[str]:
    """Formants; none on a mesh that has no airway."""
    rows = [head(["scenario", "F1", "F2", "F3", "lips, mm²"])]
    for name in VOWELS:
        answer = airway(ran(name, mesh, folder).path)
        lips = answer.sections[-1].area_mm2
        rows.append(f"| `{name}` | {' | '.join(f'{formant.frequency_hz:.0f}' for formant in answer.formants)} | {lips:.0f} |")
    return rows


def varied(values: dict[str, str], mesh: list[str], folder: Path) -> list[str]:
    rows = [head([VARIED, *POINTS, "highest point", *END])]
    for label, setting in values.items():
        done = ran(VARIED, mesh, folder, *([setting] if setting else []))
        seen = done.at()
        rows.append(f"| {label} | {' | '.join([*moved(seen, POINTS), top(seen), *soundness(done.summary)])} |")
    return rows


def jaw(mesh: list[str], folder: Path) -> list[str]:
    """No glide, and twice as much: 12 mm of opening are a turn of 8 degrees, 4 mm of glide."""
    values = {"as it is: 0.5 mm of glide a degree": "", "none": "jaw.forward_mm=0.0", "1 mm a degree": "jaw.forward_mm=8.0"}
    return varied(values, mesh, folder)


def hyoid(mesh: list[str], folder: Path) -> list[str]:
    values = {f"{stiffness} N/mm": f"hyoid.stiffness_N_per_mm={stiffness}" for stiffness in (1.76, 0.88, 3.52, 0.3, 1e6)}
    return varied(values, mesh, folder)


TABLES: dict[str, Callable[[list[str], Path], list[str]]] = {
    "vowels": vowels,
    "sounds": sounds,
    "stops": stops,
    "sequence": sequence,
    "jaw": jaw,
    "hyoid": hyoid,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("tables", nargs="*", default=list(TABLES))
    parser.add_argument("--mesh", default="medium", choices=["coarse", "medium", "fine", MEASURED])
    parser.add_argument("--out", type=Path, default=ROOT / "outputs" / "speech")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    mesh = settings_of(arguments.mesh, arguments.out)
    for name in arguments.tables:
        print(f"\n## {name}, {arguments.mesh}\n", flush=True)
        print("\n".join(TABLES[name](mesh, arguments.out)), flush=True)


if __name__ == "__main__":
    main()
