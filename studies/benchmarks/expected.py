"""Write the numbers of the tables [[expected]] of shipped scenarios anew, after a change of geometry or physics.

    python studies/benchmarks/expected.py [NAME ...]

Runs each scenario as it is and replaces the numbers of its tables; their measures and times stay. Then
``python docs/generate/scenario_tables.py`` writes the tables of the documentation, which show the same numbers.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections.abc import Mapping
from pathlib import Path

from explicitfe.results.files import open_result
from explicitfe.results.measure.numbers import numbers_at
from explicitfe.simulate.run.run import run
from explicitfe.simulate.scenario.read import read_scenario

SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"
DIGITS = {"displacement_mm": 2, "_mm": 1, "_mm2": 0, "_hz": 0}
TABLES = re.compile(r"\n\[\[expected\]\]\n(.+\n)*", re.M)


def rounded(name: str, value: float) -> str:
    """A number with the digits of its unit."""
    digits = next((count for unit, count in DIGITS.items() if name.endswith(unit)), 0)
    return f"{value:z.{digits}f}"


def table(numbers: Mapping[str, float]) -> str:
    """One table [[expected]]; displacements of a point stand in one line."""
    lines, points = ["", "[[expected]]"], dict[str, list[str]]()
    for name, value in numbers.items():
        if name.startswith("points."):
            point, key = name.removeprefix("points.").rsplit(".", 1)
            points.setdefault(point, []).append(f"{key} = {rounded(name, value)}")
        else:
            lines.append(f"{name} = {rounded(name, value)}")
    first = 3 if "time_ms" in numbers else 2
    lines[first:first] = [f"points.{point} = {{ {', '.join(keys)} }}" for point, keys in points.items()]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="scenarios; by default all with such a table")
    for name in parser.parse_args().names or sorted(path.stem for path in SCENARIOS.glob("*.toml")):
        path = SCENARIOS / f"{name}.toml"
        scenario, text = read_scenario(path)
        if not scenario.expected:
            continue
        with tempfile.TemporaryDirectory() as folder, open_result(Path(run(path, folder)["result"])) as result:
            tables = []
            for expected in scenario.expected:
                time_ms = expected.get("time_ms")
                seen = numbers_at(result, None if time_ms is None else 1e-3 * time_ms, "airway" in " ".join(expected))
                tables.append(table({key: float(seen[key] or 0.0) for key in expected if key in seen}))
        path.write_text(TABLES.sub("", text).rstrip("\n") + "\n" + "".join(tables), encoding="utf-8")
        print(f"written: {path}", flush=True)


if __name__ == "__main__":
    main()
