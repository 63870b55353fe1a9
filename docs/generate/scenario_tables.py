"""Tables of the documentation with numbers of scenarios: their tables [[expected]], and the findings of Gérard et al. (2005).

    python docs/generate/scenario_tables.py

Each table stands between ``<!-- begin NAME -->`` and ``<!-- end NAME -->``. Before it run ``studies/benchmarks/expected.py``.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path

from explicitfe.app.verify import gerard
from explicitfe.app.verify.claim import Workshop
from explicitfe.simulate.scenario.read import read_transient
from explicitfe.simulate.scenario.transient import TransientScenario

ROOT = Path(__file__).resolve().parents[2]
MUSCLES = ("ggp", "gga", "ggm", "ggh", "sl", "il", "sty", "hg", "pg", "vert", "trans", "gh", "mh")
FUNCTIONS = ("vowel-i", "vowel-i-braced", *(f"{muscle}-alone" for muscle in MUSCLES))
VOWELS = ("vowel-i-palatal", "vowel-e", "vowel-a", "vowel-o", "vowel-u")
FORMANTS = ("vowel-i", "vowel-i-braced", *VOWELS, "ggp-alone", "ggm-alone", "sty-alone", "il-alone", "hg-alone", "sl-alone")
GROOVES = ("front", "dorsum", "back")
VISIBLE_MM = 0.05


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows)) + "\n"


def scenario(name: str) -> TransientScenario:
    return read_transient(ROOT / "scenarios" / f"{name}.toml")


def moved(numbers: Mapping[str, float], point: str) -> str:
    """Displacement of a point as forward, up."""
    return ", ".join(f"{numbers[f'points.{point}.{axis}_mm']:+z.1f}" for axis in ("forward", "up")).replace("-", "−")


def functions() -> str:
    """Displacements of the points by each muscle, grooves and contact."""
    rows = []
    for name in FUNCTIONS:
        one = scenario(name)
        numbers = one.expected[0]
        forces = ", ".join(f"{muscle.name} {muscle.force_N:g}" for muscle in one.muscle)
        depths = {place: numbers[f"grooves.{place}.depth_mm"] for place in GROOVES}
        grooves = ", ".join(f"{place} {depth:.1f}" for place, depth in depths.items() if depth > VISIBLE_MM)
        points = [moved(numbers, point) for point in gerard.POINTS]
        rows.append([f"`{name}`", forces, *points, grooves, f"{numbers['contact.palate.area_mm2']:.0f}"])
    return table(["scenario", "forces, N", *gerard.POINTS, "groove, mm", "contact at the palate, mm²"], rows)


def formants() -> str:
    """Formants with the lips of each scenario."""
    rows = []
    for name in FORMANTS:
        one = scenario(name)
        numbers = one.expected[0]
        lips = "neutral" if one.lips is None else f"{one.lips.area_mm2:g} mm², {one.lips.length_mm:g} mm"
        hertz = ", ".join(f"{numbers[f'airway.formants.F{k}_hz']:.0f}" for k in (1, 2, 3))
        rows.append([f"`{name}`", lips, hertz, f"{numbers['airway.smallest_area_mm2']:.0f}"])
    return table(["scenario", "lips", "F1, F2, F3 in Hz", "narrowest section, mm²"], rows)


def findings(work: Workshop) -> str:
    """Gestures of Gérard et al. (2005) at all probes and on both tissues, with the statements that are not met."""
    rows = []
    for gesture, tissue in product(gerard.GESTURES, [gerard.Findings(work, tissue) for tissue in gerard.TISSUES]):
        points = [", ".join(f"{mm:+z.1f}" for mm in tissue.displacement_mm(gesture, point)) for point in gerard.POINTS]
        cells = [*points, f"{tissue.groove_mm(gesture):z.1f}", "; ".join(tissue.unmet(gesture))]
        rows.append([gesture, tissue.tissue, *(cell.replace("-", "−") for cell in cells)])
    return table(["gesture", "tissue", *gerard.POINTS, "groove", "not met"], rows)


TABLES: dict[str, tuple[str, Callable[[], str]]] = {
    "functions": ("docs/reference/tongue.md", functions),
    "formants": ("docs/reference/airway.md", formants),
}


def marks(name: str) -> tuple[str, str]:
    """The comments before and after a table."""
    return f"<!-- begin {name} -->\n", f"<!-- end {name} -->"


def write(name: str, page: str, text: str) -> None:
    """Replace a table of a page."""
    begin, end = marks(name)
    before, _, rest = (ROOT / page).read_text(encoding="utf-8").partition(begin)
    (ROOT / page).write_text(before + begin + text + end + rest.partition(end)[2], encoding="utf-8")
    print(f"written: {name} in {page}")


def main() -> None:
    for name, (page, make) in TABLES.items():
        write(name, page, make())
    with tempfile.TemporaryDirectory() as folder:
        write("gerard-2005", "docs/reference/tongue.md", findings(Workshop(Path(folder))))


if __name__ == "__main__":
    main()
