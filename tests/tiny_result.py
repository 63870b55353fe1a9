"""A result of two hexes whose numbers follow from the number of the step, so that right ones can be told from any others."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from support import ROOT, result_writer

from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.results.files import FINISHED, Quantity, ResultWriter

HISTORY = {"kinetic_energy": Quantity("J", 1, "of all nodes"), "probe_tip_displacement": Quantity("m", 3)}
SCENARIO = 'title = "Zunge, größer"\n'


def two_hexes() -> HexMesh:
    x, y, z = np.meshgrid([0.0, 0.01], [0.0, 0.01], [0.0, 0.01, 0.02], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    base = np.array([0, 6, 9, 3])
    hexes = np.array([[*(base + k), *(base + k + 1)] for k in range(2)])
    mesh = HexMesh(points, hexes, {"jaw": np.array([0, 3, 6, 9])}).with_named_nodes({"tip": 11})
    inside = mesh.points_in(np.array([1]), np.array([[0.5, -0.25, 0.125]]))
    return replace(mesh, named_points=mesh.named_points | {"inside": inside})


MESH = two_hexes()
N, E = MESH.node_count, MESH.element_count


def displacement(step: int) -> np.ndarray:
    return np.sin(step + 0.1 * np.arange(3 * N).reshape(N, 3))


def jacobian(step: int) -> np.ndarray:
    return np.cos(step + 0.1 * np.arange(E))


def start(path: Path, **changes) -> ResultWriter:
    options = {
        "mesh": MESH,
        "point_fields": {"velocity": Quantity("m/s", 3)},
        "cell_fields": {"J": Quantity("1"), "hourglass_energy": Quantity("J")},
        "history": HISTORY,
        "scenario_text": SCENARIO,
        "model": {"density": np.float64(1040.0)},
        "provenance": {"explicitfe": "test"},
        "restart": {"half_step_velocity": np.zeros((N, 3)), "step": 0},
        "expected_samples": 4,
    }
    return result_writer(path, **options | changes)


def add(result: ResultWriter, step: int) -> None:
    """One sample, one history row and one restart state, all of them telling ``step``."""
    u = displacement(step)
    row = {"kinetic_energy": step + 0.5, "probe_tip_displacement": u[11]}
    cells = {"J": jacobian(step), "hourglass_energy": -jacobian(step)}
    result.sample(1e-3 * step, row, {"displacement": u, "velocity": -u}, cells)
    result.restart({"half_step_velocity": u, "step": step})


def write(path: Path, steps: int, **changes) -> Path:
    with start(path, **changes) as result:
        for step in range(steps):
            add(result, step)
        return result.finish(FINISHED, "", {"steps": steps})


def check_steps(result, count: int) -> None:
    """The result has exactly the first ``count`` steps, history rows and the restart state that go with them."""
    np.testing.assert_array_equal(result.times, 1e-3 * np.arange(count))
    for step in range(count):
        np.testing.assert_array_equal(result.displacement(step), displacement(step))
        np.testing.assert_array_equal(result.field("velocity", step), -displacement(step))
        np.testing.assert_array_equal(result.field("J", step), jacobian(step))
        np.testing.assert_array_equal(result.field("hourglass_energy", step), -jacobian(step))
    check_history_and_restart(result, count)


def check_history_and_restart(result, count: int) -> None:
    np.testing.assert_array_equal(result.history("time"), 1e-3 * np.arange(count))
    np.testing.assert_array_equal(result.history("kinetic_energy"), np.arange(count) + 0.5)
    state = result.restart_state()
    if state is None:
        assert count <= 1
    else:
        assert state.sequence in (count - 1, count)
        assert state.arrays["step"] == state.sequence - 1
        assert abs(state.stored_at - time.time()) < 3600.0
        np.testing.assert_array_equal(state.arrays["half_step_velocity"], displacement(state.sequence - 1))


def environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(ROOT)}


def python(code: str) -> subprocess.CompletedProcess:
    done = subprocess.run([sys.executable, "-c", code], env=environment(), capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done


def wait_for(condition, child: subprocess.Popen) -> None:
    end = time.monotonic() + 60
    while not condition():
        assert child.poll() is None
        assert time.monotonic() < end
        time.sleep(0.005)
