"""The measured hex tongue of ArtiSynth / GIPSA-lab as a model file, and vowel [i] on it.

    python benchmarks/real_tongue.py FOLDER --out DIR

FOLDER holds ``hextongue.vtu``, ``muscles.json`` and ``fixed.json`` (a neutral copy of the geometry of Stavness, Lloyd, Payan
& Fels 2011, Buchaillard, Perrier & Payan 2009). The mesh is read where it lies; DIR receives ``real-tongue.toml``, the model
file, and ``real-tongue-vowel-i.toml``, a scenario, which ``explicitfe run`` takes. The mesh is a stress test: its edges run
from 0.8 to 21 mm and its smallest scaled Jacobian is 0.007.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

# The bundle names of the source -> ours.
NAMES = {"GGA": "GGa", "GGM": "GGm", "GGP": "GGp"}
# Node numbers of the source's README, beside those that fixed.json names.
POINTS = {"dorsum": 869, "root": 859}

SCENARIO = """\
title = "Vowel [i] on the measured tongue"
question = "Does the built-in tongue move as the measured mesh does?"

[model]
file = "real-tongue.toml"
material = "gerard-2005"
damping = {{ alpha_per_s = 40.0 }}

[[muscle]]
name = "GGp"
force_N = 2.0
distribution = "{distribution}"

[[muscle]]
name = "GGa"
force_N = 0.2
distribution = "{distribution}"

[analysis]
duration_ms = 120.0
"""


def write_model(folder: Path, out: Path) -> Path:
    """Write the model file of the mesh in ``folder`` into ``out``; give its path."""
    bundles = json.loads((folder / "muscles.json").read_text())
    fixed = json.loads((folder / "fixed.json").read_text())
    styloid = {int(node): point for node, point in bundles["styloid_nodes"].items()}
    lines = [
        'title = "Measured hex tongue"',
        'source = "Stavness, Lloyd, Payan, Fels (2011); Buchaillard, Perrier, Payan (2009)"',
        f"mesh = {json.dumps(str((folder / 'hextongue.vtu').resolve()))}",
        'length_unit = "m"',
        'fixed = ["jaw", "hyoid"]',
        "",
        "[node_sets]",
        f"jaw = {fixed['jaw']}",
        f"hyoid = {fixed['hyoid']}",
        "",
        "[named_points]",
        f"tip = {fixed['named_nodes']['tip']}",
        *(f"{name} = {node}" for name, node in POINTS.items()),
    ]
    fibres: dict[str, list[tuple[str, list[int]]]] = {}
    for bundle in bundles["bundles"].values():
        name = NAMES.get(bundle["muscle"], bundle["muscle"])
        side = {"L": "left", "R": "right"}.get(bundle["side"])
        chains = bundle["fibres"]
        for number, chain in enumerate(chains):
            # The one bundle without sides (SL) lists its left half first.
            fibres.setdefault(name, []).append((side or ("left", "right")[2 * number // len(chains)], chain))
    for name, chains in fibres.items():
        lines += ["", "[[muscle]]", f'name = "{name}"']
        lines += [f"max_force_N = {bundles['muscle_max_force_N'][name.upper()]}"]
        for side, chain in chains:
            lines += ["[[muscle.fibre]]", f'side = "{side}"']
            if chain[-1] in styloid:  # the source lists the bone last, a model file has the origin first
                lines += [f"anchor = {styloid[chain[-1]]}", f"nodes = {chain[-2::-1]}"]
            else:
                lines += [f"nodes = {chain}"]
    out.mkdir(parents=True, exist_ok=True)
    path = out / "real-tongue.toml"
    path.write_text("\n".join(lines) + "\n")
    return path


def write_scenario(out: Path, distribution: str = "ends") -> Path:
    """Write the scenario that goes with the model file into ``out``; give its path."""
    path = out / "real-tongue-vowel-i.toml"
    path.write_text(SCENARIO.format(distribution=distribution))
    return path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("outputs"))
    arguments = parser.parse_args()
    write_model(arguments.folder, arguments.out)
    scenario = write_scenario(arguments.out)
    print(f"written: {scenario}; now: explicitfe run {scenario}")


if __name__ == "__main__":
    main()
