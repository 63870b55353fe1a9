"""The same step in C++: ``peer_cpp.cpp``, compiled for this machine into a temporary folder when a benchmark asks for it."""

from __future__ import annotations

import atexit
import ctypes
import os
import shutil
import subprocess
import sys
import tempfile
import time
from functools import cache
from pathlib import Path

import numpy as np

from explicitfe.fem.elements import hex8
from explicitfe.fem.solve.kernels import ELEMENTS
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.platform.compiled.arrays import in_blocks, zeros
from explicitfe.platform.compiled.simd import WIDTH

SOURCE = Path(__file__).with_suffix(".cpp")
COMPILERS = ("g++", "clang++")
# As ours: products and sums may fuse, nothing else is reordered; nobody asks for errno or floating-point exceptions.
FLAGS = ("-std=c++17", "-O3", "-march=native", "-ffp-contract=fast", "-fno-math-errno", "-fno-trapping-math")
# All loops over corners, modes and components are written out: the compilers stop early otherwise.
UNROLLED = {
    "clang": ("-mllvm", "-unroll-threshold=20000"),
    "gcc": ("--param", "max-completely-peeled-insns=20000", "--param", "max-completely-peel-times=32"),
}
GEOMETRIES = ("read", "derived")  # numbers of the elements are read, or derived from the positions of their nodes at each step
TRIAL_ROUNDS = 4
TRIAL_S = 0.03


def compiler() -> str | None:
    """The C++ compiler that CXX names, or the first of ``COMPILERS`` that is there."""
    names = [os.environ["CXX"]] if os.environ.get("CXX") else COMPILERS
    return next((path for path in map(shutil.which, names) if path), None)


def version() -> str:
    """What the compiler says of itself."""
    return subprocess.run([compiler() or "", "--version"], capture_output=True, text=True, check=True).stdout.splitlines()[0]


@cache
def library() -> ctypes.CDLL:
    """The compiled kernels, with as many lanes as ours have."""
    folder = tempfile.mkdtemp(prefix="peer-cpp-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    target = Path(folder) / "peer_cpp.so"
    flags = (*FLAGS, *UNROLLED["clang" if "clang" in version() else "gcc"], f"-DLANES={WIDTH}")
    subprocess.run([compiler() or "", *flags, "-shared", "-fPIC", "-o", target, SOURCE], check=True)
    return ctypes.CDLL(str(target))


class CppBody(ctypes.Structure):
    """``Body`` of peer_cpp.cpp."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("blocks", "entries")),
        *((name, ctypes.c_void_p) for name in ("u", "v", "force", "weight", "position", "numbers", "nodes")),
        *(
            (name, ctypes.c_double)
            for name in ("C10", "C20", "C30", "K", "keep", "gain", "dt", "alpha", "damping_loss", "smallest_J")
        ),
    )


class InCpp:
    """Vectors of the compiler, blocks of elements and node rows as ours; one law for all elements, no external forces.

    Parameters
    ----------
    simulation, dt_s : the body at the start, and its step.
    geometry : one of ``GEOMETRIES``; the one that is faster at this size if left out.
    """

    def __init__(self, simulation: Simulation, dt_s: float, geometry: str | None = None) -> None:
        blocks, nodes, model = simulation.blocks, simulation.nodes, simulation.model
        self._start = [array.copy() for array in simulation.state]
        self._state = [zeros(array.shape) for array in simulation.state]
        count = len(blocks.nodes)
        corners = simulation.points[simulation.hexes]
        shape = hex8.geometry(corners)
        numbers = in_blocks(np.hstack([shape, ELEMENTS[model.element][1].constants(corners, shape)]))
        self._arrays = (*self._state, nodes.update, blocks.position, numbers, blocks.nodes)  # the addresses below are theirs
        half = 0.5 * model.alpha_per_s * dt_s
        self._body = CppBody(
            count,
            blocks.position.size,
            *(array.ctypes.data for array in self._arrays),
            *simulation.constants[0],
            (1.0 - half) / (1.0 + half),
            dt_s / (1.0 + half),
            dt_s,
            model.alpha_per_s,
        )
        self._element = model.element.replace("-", "_")
        self.take(geometry or self._faster())

    def take(self, geometry: str) -> None:
        """Go on from the start, with this geometry."""
        self.geometry = geometry
        self._advance = getattr(library(), f"{self._element}_{geometry}")
        self.reset()

    def _faster(self) -> str:
        """The geometry with which a step is faster at this size."""
        best = dict.fromkeys(GEOMETRIES, np.inf)
        for geometry in GEOMETRIES * TRIAL_ROUNDS:
            self.take(geometry)
            steps, begin = 0, time.process_time()
            while time.process_time() - begin < TRIAL_S:
                self.run(2)
                steps += 2
            best[geometry] = min(best[geometry], (time.process_time() - begin) / steps)
        ns = {name: 1e9 * value / (self._body.blocks * WIDTH) for name, value in best.items()}
        print(f"  c++: geometry {', '.join(f'{name} {value:.1f} ns' for name, value in ns.items())}", file=sys.stderr, flush=True)
        return min(ns, key=ns.__getitem__)

    def reset(self) -> None:
        for array, start in zip(self._state, self._start, strict=True):
            array[:] = start
        self._body.damping_loss, self._body.smallest_J = 0.0, np.inf

    def run(self, steps: int) -> None:
        self._advance(ctypes.byref(self._body), ctypes.c_int64(steps))

    def displacement(self) -> np.ndarray:
        return self._state[0][:, :3]

    def ledger(self) -> tuple[float, float]:
        """Loss to damping since the start [J], and the smallest J."""
        return self._body.damping_loss, self._body.smallest_J
