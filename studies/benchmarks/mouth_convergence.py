"""How the mesh changes [i], [t], [k], GGp and SL: displacements of ten probes, contact areas and pressures on three meshes.

    python studies/benchmarks/mouth_convergence.py OUT

Prints the tables of docs/studies/mouth.md. The probes are the seven named points of the tongue, and three at its side.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import explicitfe
from explicitfe.fem.mesh.hexmesh import MaterialPoints
from explicitfe.fem.mesh.surface_points import surface_areas
from explicitfe.results.measure.steps import step_at
from explicitfe.simulate.anatomy import catalogue

MESHES = ("coarse", "medium", "fine")
SOUNDS = {
    "[i]": ("vowel-i-palatal", 0.2),
    "[t]": ("alveolar-t", 0.14),
    "[k]": ("velar-k", 0.14),
    "GGp": ("ggp-alone", 0.2),
    "SL": ("sl-alone", 0.2),
}
# Material coordinates (s, t, w) of the probes at the side, above the widest place.
SIDES = {"side of the blade": (0.25, 0.8, 0.8), "side of the dorsum": (0.45, 0.8, 0.8), "side of the root": (0.75, 0.8, 0.8)}
CONTACTS = {"palate": "contact_pressure_palate", "jaw": "contact_pressure_jaw", "velum, both sides": "surface_pressure"}


def probes(resolution: str) -> dict[str, MaterialPoints]:
    """The ten probes in the mesh of a resolution."""
    cells = catalogue.cells_of("tongue", resolution, None)
    sides = catalogue.contour("tongue").locate(np.array(list(SIDES.values())), cells)
    at_side = {
        name: MaterialPoints(sides.element[[row]], sides.natural[[row]], sides.position[[row]]) for row, name in enumerate(SIDES)
    }
    return dict(catalogue.built_in("tongue", resolution).mesh.named_points) | at_side


def answer(scenario: str, time_s: float, resolution: str, out: Path) -> tuple[np.ndarray, dict[str, tuple[float, float]]]:
    """Displacements (10, 3) mm of the probes, and area mm^2 and largest pressure kPa of each contact."""
    done = explicitfe.run(
        Path("scenarios") / f"{scenario}.toml",
        out,
        name=f"{scenario}-{resolution}",
        settings={"model.resolution": resolution},
        overwrite=True,
    )
    with explicitfe.open_result(done["result"]) as result:
        mesh, step = result.mesh, step_at(result, time_s)
        displacement = result.displacement(step)
        moved = [mesh.at(point, displacement)[0] for point in probes(resolution).values()]
        areas = surface_areas(mesh)
        touched = {}
        for name, field in CONTACTS.items():
            if field in result.fields:
                pressure = result.field(field, step)
                touched[name] = (1e6 * float(areas[pressure > 0.0].sum()), 1e-3 * float(pressure.max()))
    return 1e3 * np.array(moved), touched


def main(out: Path) -> None:
    """Print one table of probes for each sound, and one of contacts."""
    contacts = ["| sound | surface | " + " | ".join(f"{mesh}: mm², kPa" for mesh in MESHES) + " |", "|---|---|---|---|---|"]
    names = list(probes("coarse"))
    titles = (f"{sound}: fine, mm | off: coarse, medium" for sound in SOUNDS)
    differences = ["| probe | " + " | ".join(titles) + " |", "|---|" + "---|---|" * len(SOUNDS)]
    rows: dict[str, list[str]] = {name: [] for name in names}
    for sound, (scenario, time_s) in SOUNDS.items():
        moved, touched = zip(*(answer(scenario, time_s, mesh, out) for mesh in MESHES), strict=True)
        off = [np.linalg.norm(one - moved[2], axis=1) for one in moved[:2]]
        for row, name in enumerate(names):
            x, _, z = moved[2][row]
            rows[name].append(f"{-x:+.1f}, {z:+.1f} | {off[0][row]:.2f}, {off[1][row]:.2f}")
        for surface in touched[0]:
            figures = (f"{one[surface][0]:.0f}, {one[surface][1]:.2f}" for one in touched)
            contacts.append(f"| {sound} | {surface} | " + " | ".join(figures) + " |")
        scale = np.linalg.norm(moved[2], axis=1).max()
        print(f"{sound}: rms {np.sqrt((off[0] ** 2).mean()):.2f}, {np.sqrt((off[1] ** 2).mean()):.2f} mm of {scale:.1f} mm")
    print("\n".join([*differences, *(f"| {name} | {' | '.join(cells)} |" for name, cells in rows.items()), "", *contacts]))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
