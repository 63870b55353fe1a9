"""Results that nobody has to compute: the coarse tongue pushed by a closed form, under a palate; a block under a ball."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from support import result_writer, tongue

from explicitfe.fem.mesh.box import box
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.triangles import surface_triangles
from explicitfe.results.files import FINISHED, Quantity

ENERGIES = ("external_work", "internal_energy", "hourglass_energy", "kinetic_energy", "damping_loss", "balance_error")
FRAMES, DURATION_S = 11, 0.1
PUSH_M = np.array([-0.006, 0.0, 0.003])


def plate() -> tuple[np.ndarray, np.ndarray]:
    """A palate: a flat block above the tongue."""
    points = tongue().mesh.points
    low, high = points.min(axis=0), points.max(axis=0)
    block = box((4, 4, 1), (high - low) * [1.0, 1.0, 0.1])
    corners, _ = surface_triangles(block, block.points + [low[0], low[1], high[2] + 0.004])
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


def displacement(share: float) -> np.ndarray:
    """Of all nodes (n, 3) m when a share of the push is there: the top goes all the way, the base not at all."""
    points = tongue().mesh.points
    height = (points[:, 2] - points[:, 2].min()) / np.ptp(points[:, 2])
    return share * height[:, None] * PUSH_M


def scenario(**changes: Any) -> dict[str, Any]:
    """A scenario with all keys that a report speaks of."""
    return {
        "title": "A push",
        "question": "Does it go forward?",
        "analysis": {"type": "transient", "duration_ms": 100.0},
        "muscle": [{"name": "GGp", "force_N": 2.0}],
        **changes,
    }


def write_gesture(path: Path, warnings: list[str] | None = None, frames: int = FRAMES, push: float = 1.0, **changes: Any) -> Path:
    """A finished result of a push; ``changes`` are keys of its scenario, or the material of its model."""
    material = changes.pop("material", {})
    mesh, stated = tongue().mesh, scenario(**changes)
    title = str(stated["title"])
    history = {name: Quantity("J") for name in ENERGIES}
    for name in mesh.named_points:
        history |= {f"probe_{name}_displacement": Quantity("m", 3), f"probe_{name}_velocity": Quantity("m/s", 3)}
    with result_writer(
        path,
        mesh=mesh,
        bones={"palate": plate()},
        cell_fields={"J": Quantity("1")},
        point_fields={"velocity": Quantity("m/s", 3)},
        history=history,
        scenario_text="# --set muscle.GGp.force_N=2.0\n# --set title=It's a push\ntitle = 'push'\n# --set no setting\n",
        model={
            "name": "tongue",
            "scenario": stated,
            "scenario_file": "push.toml",
            "muscles": stated["muscle"],
            "material": material,
        },
        provenance={"explicitfe": "test", "processor": "<none>"},
        overwrite=True,
    ) as result:
        for number in range(frames):
            share = push * number / max(frames - 1, 1)
            moved, velocity = displacement(share), displacement(push / DURATION_S)
            row = dict.fromkeys(ENERGIES, 1e-3 * share) | {"external_work": 4e-3 * share, "balance_error": 1e-5 * (1.0 + number)}
            for name, point in mesh.named_points.items():
                node = int(np.argmin(np.linalg.norm(mesh.points - point.position[0], axis=1)))
                row |= {f"probe_{name}_displacement": moved[node], f"probe_{name}_velocity": velocity[node]}
            cells = {"J": 1.0 + 0.01 * share * np.linspace(-1.0, 1.0, mesh.element_count)}
            result.sample(DURATION_S * number / max(frames - 1, 1), row, {"displacement": moved, "velocity": velocity}, cells)
        return result.finish(FINISHED, "", {"title": title, "warnings": warnings or [], "settled": False})


def write_indentation(path: Path, depths_mm: tuple[float, ...] = (0.0, 1.0, 2.0)) -> Path:
    """A block of 20 x 20 x 10 mm whose whole top sinks as far as a ball of 5 mm goes down, with as many N as that is mm."""
    block = box((4, 4, 2), (0.02, 0.02, 0.01))
    mesh = HexMesh(block.points - [0.01, 0.01, 0.0], block.hexes)
    names = ("force", "indentation")
    with result_writer(
        path,
        mesh=mesh,
        history={name: Quantity(unit) for name, unit in zip(names, ("N", "m"), strict=True)},
        scenario_text="title = 'a ball'\n",
        model={"tool": {"shape": "sphere", "radius_mm": 5.0}, "scenario": {"analysis": {"type": "relaxation"}}},
        provenance={"explicitfe": "test"},
        overwrite=True,
    ) as result:
        for number, depth_mm in enumerate(depths_mm):
            moved = -1e-3 * depth_mm * mesh.points[:, [2]] / 0.01 * [0.0, 0.0, 1.0]
            result.sample(float(number), {"force": depth_mm, "indentation": 1e-3 * depth_mm}, {"displacement": moved}, {})
        return result.finish(FINISHED, "", {"title": "a ball", "warnings": []})
