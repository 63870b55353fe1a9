"""Results do not depend on how many elements are computed at once: 2, 4 and 8 lanes agree to rounding.

EXPLICITFE_LANES forces a number, so that one machine tests all of them; each number is a process of its own, as lanes are fixed
when the package is imported. The whole suite can be run so as well: ``EXPLICITFE_LANES=2 python -m pytest``.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from support import ROOT

pytestmark = pytest.mark.slow

LANES = (2, 4, 8)

# Nine elements, so that the last block of lanes is part empty whatever their number, with an inclusion and effects with a memory;
# a point with two free faces, whose Newton steps need four states at once; and an indentation. Effects of the material that
# cannot be combined are spread over the three, as every kernel is compiled for each number of lanes.
COMPUTE = """
import json, sys
from dataclasses import replace
sys.path.insert(0, "tests")
import numpy as np
from support import YEOH, block_mesh, deformed, elastic_energies, force_scale, model_of, small_indentation
from explicitfe.platform.compiled.simd import WIDTH
from explicitfe.fem.effects.material.discovered_law import DiscoveredLaw
from explicitfe.fem.effects.material.nonlinear_relaxation import NonlinearSeries
from explicitfe.fem.effects.material.payne import Payne
from explicitfe.fem.effects.material.permanent_set import PermanentSet
from explicitfe.fem.effects.material.power_law import PowerLaw
from explicitfe.fem.effects.specimen.inclusion import InclusionBelowTool
from explicitfe.fem.solve import point
from explicitfe.fem.solve.equilibrium import Relaxation
from explicitfe.fem.solve.simulation import Simulation

mesh = block_mesh((3, 3, 1), seed=9)
u = deformed(mesh, np.random.default_rng(9), 0.3, 0.1)
effects = (
    NonlinearSeries(g=(0.4,), tau_s=(0.3,), exponent=-0.7),
    PermanentSet(modulus_Pa=60.0),
    Payne(modulus_Pa=80.0, yield_shear=0.05),
)
inclusion = InclusionBelowTool(ratio=3.0, radius_mm=12.0, depth_mm=1.0)
model = inclusion.apply(model_of(mesh, effects=effects))
answers = {"lanes": WIDTH, "forces": [], "stiffness": float(np.ptp(model.stiffness))}
body = Simulation(model)
for increment_s, share in ((0.0, 0.5), (0.1, 1.0), (0.1, 0.7)):
    body.set_increment(increment_s)
    answers["forces"].append((body.internal_force(share * u) / force_scale(body)).tolist())
    body.blocks.old[:] = body.blocks.new
answers["energies"] = list(elastic_energies(body, 0.7 * u))
law = DiscoveredLaw(tau_s=(0.0, 0.2), c10_Pa=(3.0, 10.0), c01_Pa=(2.0, 40.0), c20_Pa=(5.0, 5.0), c03_Pa=(1.0, 2.0))
answers["stress"] = point.uniaxial(YEOH, (law,), np.linspace(0.0, 1.0, 11), np.linspace(1.0, 0.6, 11)).tolist()
pressed = replace(small_indentation(symmetry="quarter", edge_size_mm=1.2), effects=(PowerLaw(exponent=0.2, tau_s=0.1),))
tools = [Relaxation(pressed, 1e-6, threads=count) for count in (1, 2)]
answers["threads"] = [len(tool.parts) for tool in tools]
answers["loads"] = [tool.move(2e-4, at_s=1.0).force_N for tool in tools]
json.dump(answers, sys.stdout)
"""


@pytest.fixture(scope="module")
def answers() -> dict[int, dict[str, Any]]:
    """What each number of lanes computes."""

    def start(lanes: int) -> subprocess.Popen[str]:
        environment = os.environ | {"EXPLICITFE_LANES": str(lanes), "PYTHONPATH": str(ROOT)}
        command = [sys.executable, "-c", COMPUTE]
        return subprocess.Popen(command, env=environment, cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    processes = {lanes: start(lanes) for lanes in LANES}
    results = {}
    for lanes, process in processes.items():
        out, error = process.communicate()
        assert process.returncode == 0, error
        results[lanes] = json.loads(out)
    return results


@pytest.mark.parametrize("lanes", LANES)
def test_lanes_are_those_asked_for(lanes, answers):
    assert answers[lanes]["lanes"] == lanes


@pytest.mark.parametrize("lanes", LANES[:-1])
def test_forces_and_energies_agree(lanes, answers, record_property):
    """Elements are the same operations in every lane. Only sums over elements are in another order: at a node up to eight forces
    of 1 S, 8 eps / 2 = 1e-15 S; as the sum of four corner values and of differences before it may be fused otherwise, ten times
    that, 1e-14 S. Energies are sums of nine: 1e-14 of them.
    """
    one, other = answers[lanes], answers[8]
    off = np.abs(np.array(one["forces"]) - np.array(other["forces"])).max()
    record_property("forces off by", off)
    assert np.abs(other["forces"]).max() > 1e-2 and other["stiffness"] > 1.0
    assert off < 1e-14
    assert one["energies"] == pytest.approx(other["energies"], rel=1e-14)


@pytest.mark.parametrize("lanes", LANES[:-1])
def test_a_point_agrees(lanes, answers):
    """One state without sums: the same Newton steps, fused alike or not; they stop at 1e-9 of the stiffness."""
    assert answers[lanes]["stress"] == pytest.approx(answers[8]["stress"], rel=1e-9)


@pytest.mark.parametrize("lanes", LANES[:-1])
def test_an_equilibrium_agrees(lanes, answers, record_property):
    """All end with residual forces below 1e-6 of the tool's force, each from another side of it: 1e-5 of the force. So do two
    threads.
    """
    off = np.abs(np.array(answers[lanes]["loads"]) / answers[8]["loads"][0] - 1.0).max()
    record_property("load off by", off)
    assert answers[lanes]["threads"] == [1, 2]
    assert off < 1e-5


@pytest.mark.parametrize("lanes", ["3", "16", "many", "-4"])
def test_an_impossible_number_is_one_sentence(lanes):
    environment = os.environ | {"EXPLICITFE_LANES": lanes}
    command = [sys.executable, "-m", "explicitfe", "run", "scenarios/vowel-i.toml"]
    done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert f'EXPLICITFE_LANES is "{lanes}"; it can be 2, 4 or 8.' in done.stderr
    assert "Traceback" not in done.stderr
