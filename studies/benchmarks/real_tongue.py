"""The measured hex tongue of ArtiSynth / GIPSA-lab as a model file, and vowel [i] on it.

    python studies/benchmarks/real_tongue.py FOLDER --out DIR

FOLDER holds ``hextongue.vtu``, ``muscles.json`` and ``fixed.json`` (a neutral copy of the geometry of Stavness, Lloyd, Payan
& Fels 2011, Buchaillard, Perrier & Payan 2009). The mesh is read where it lies; DIR receives ``real-tongue.toml``, the model
file, and ``real-tongue-vowel-i.toml``, a scenario, which ``explicitfe run`` takes. The mesh is a stress test: its edges run
from 0.8 to 21 mm and its smallest scaled Jacobian is 0.007.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import meshio

# The bundle names of the source -> ours.
NAMES = {"GGA": "GGa", "GGM": "GGm", "GGP": "GGp"}
# Node numbers of the source's README, beside those that fixed.json names.
POINTS = {"dorsum": 869, "root": 859}
# With muscles as stress: nodes of the upper midline beside the points of the built-in tongue (0.3 to 0.9 mm, dorsum 1.6 mm).
MORE_POINTS = {"blade": 912, "front": 873, "back": 908}
# Muscles whose fibres meet at the tubercle, and over how wide a patch they are spread there, as in models/tongue/muscles.toml.
ORIGIN_WIDTH_MM = {"GGa": 5.0, "GGm": 5.0, "GGp": 5.0, "GGh": 5.0}
# GGh is the lower third of the source's GGP, in fibres, as in models/tongue/muscles.toml: those that end lowest.
HORIZONTAL_SHARE = 1.0 / 3.0

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


def write_model(folder: Path, out: Path, *, as_stress: bool = False) -> Path:
    """Write the model file of the mesh in ``folder`` into ``out``; give its path.

    ``as_stress``: as the built-in tongue has them where muscles act as stress, GGh is parted from GGp, the genioglossus is spread
    at its origin, SL pulls in proportion to its section, and there are points between tip and root.
    """
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
        *(f"{name} = {node}" for name, node in (POINTS | (MORE_POINTS if as_stress else {})).items()),
    ]
    fibres: dict[str, list[tuple[str, list[int]]]] = {}
    force_N = {NAMES.get(name, name): force for name, force in bundles["muscle_max_force_N"].items()}
    tension: dict[tuple[int, ...], list[float]] = {}
    for bundle in bundles["bundles"].values():
        name = NAMES.get(bundle["muscle"], bundle["muscle"])
        side = {"L": "left", "R": "right"}.get(bundle["side"])
        chains = bundle["fibres"]
        for number, chain in enumerate(chains):
            # The one bundle without sides (SL) lists its left half first.
            fibres.setdefault(name, []).append((side or ("left", "right")[2 * number // len(chains)], chain))
            if as_stress and name == "SL":
                of_segments = bundle["segment_max_force_N"][number]
                tension[tuple(chain)] = [of_segments[0], *map(_mean, of_segments, of_segments[1:]), of_segments[-1]]
    if as_stress:
        _part_genioglossus(fibres, force_N, folder)
    for name, chains in fibres.items():
        lines += ["", "[[muscle]]", f'name = "{name}"', f"max_force_N = {force_N[name]}"]
        lines += [f"origin_width_mm = {ORIGIN_WIDTH_MM[name]}"] if as_stress and name in ORIGIN_WIDTH_MM else []
        for side, chain in chains:
            lines += ["[[muscle.fibre]]", f'side = "{side}"']
            if chain[-1] in styloid:  # the source lists the bone last, a model file has the origin first
                lines += [f"anchor = {styloid[chain[-1]]}", f"nodes = {chain[-2::-1]}"]
            else:
                lines += [f"nodes = {chain}"]
            if tuple(chain) in tension:
                lines += [f"tension = {tension[tuple(chain)]}"]
    out.mkdir(parents=True, exist_ok=True)
    path = out / "real-tongue.toml"
    path.write_text("\n".join(lines) + "\n")
    return path


def _part_genioglossus(fibres: dict[str, list[tuple[str, list[int]]]], force_N: dict[str, float], folder: Path) -> None:
    """Make the fibres of GGp that end lowest a muscle of their own, with its part of the force."""
    height = meshio.read(folder / "hextongue.vtu").points[:, 2]
    upwards = sorted(fibres["GGp"], key=lambda fibre: float(height[fibre[1][-1]]))
    count = round(HORIZONTAL_SHARE * len(upwards))
    fibres["GGh"], fibres["GGp"] = upwards[:count], upwards[count:]
    force_N["GGh"], force_N["GGp"] = HORIZONTAL_SHARE * force_N["GGp"], (1.0 - HORIZONTAL_SHARE) * force_N["GGp"]


def _mean(a: float, b: float) -> float:
    return 0.5 * (a + b)


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
