"""Cases of the foreign family: two programs that share no code agree, and what is written can be read."""

from __future__ import annotations

import numpy as np
import pytest

from explicitfe.inverse.measured.read import read_dataset
from studies.blind.case import CaseRequest, write
from studies.blind.closed_forms import Bench
from studies.blind.foreign import family, tool_cases
from studies.blind.foreign.closed import ForeignBench, power_law_terms
from studies.blind.grid import HomogeneousRun
from studies.blind.make import make, numbers
from studies.blind.protocols import draw_protocol

EFFECTS = {
    "viscoelastic": {"g": [0.3], "tau_s": [3.0]},
    "softening": {"inverse_r": 0.3, "m_Pa": 20.0},
    "third-yeoh": {"C30_Pa": 50.0},
    "fibres": {"k1_Pa": 300.0, "k2": 1.0},
    "cycle-drift": {"per_cycle": 0.02},
}
ON_A_PLATEN = {
    "contact-offset": {"offset_mm": -0.2},
    "compliance": {"compliance_mm_N": 0.3},
    "preload": {"force_N": 0.02},
    "layer": {"thickness_mm": 1.0, "ratio": 3.0},
    "stiffness-gradient": {"g": 0.4},
}


@pytest.mark.parametrize("seed", [101, 104, 107, 110])
def test_two_programs_agree_about_the_same_effect(seed):
    protocol = draw_protocol(np.random.default_rng(seed))
    foreign, own = ForeignBench(protocol.plan, protocol.mode), Bench(protocol.plan, protocol.mode, poisson=0.4999999)
    effects = EFFECTS | (ON_A_PLATEN if protocol.mode == "platen" else {})
    for name, parameters in effects.items():
        a, b = (bench.values(200.0, 150.0, {name: parameters}) for bench in (foreign, own))
        assert np.abs(a - b).max() < 3e-4 * np.abs(b).max(), name


def test_a_power_law_is_a_sum_of_terms():
    terms = power_law_terms({"exponent": 0.25, "tau_s": 0.5})
    t = np.array([0.01, 0.5, 5.0, 300.0])
    left = 1.0 - sum(g * (1.0 - np.exp(-t / tau)) for g, tau in terms)
    assert left == pytest.approx((1.0 + t / 0.5) ** -0.25, abs=0.01)


OUTSIDE = {  # effects that no other generator computes, and laws that no library has
    "power-law": {"exponent": 0.2, "tau_s": 0.1},
    "permanent-set": {"share": 0.1},
    "stick-slip": {"length": 0.07, "drag": 20.0},
    "threshold": {"strain": 0.05, "modulus_Pa": 2000.0},
    "mooney": {"C01_Pa": 100.0},
    "viscous": {"eta_Pa_s": 1000.0},
    "ageing": {"per_s": 1e-3},
    "saturation": {"limit": 1000.0},
}


@pytest.mark.parametrize("name", OUTSIDE)
def test_what_only_this_family_computes_changes_the_data(name):
    time_s = np.array([0.0, 2.0, 4.0, 60.0, 62.0, 64.0])
    run = HomogeneousRun("curve-1", time_s, 1.0 - np.array([0.0, 0.15, 0.31, 0.31, 0.15, 0.0]))
    bench = ForeignBench([run], "uniaxial")
    plain, changed = (bench.values(200.0, 100.0, effects) for effects in ({}, {name: OUTSIDE[name]}))
    assert np.abs(changed - plain).max() > 0.01 * np.abs(plain).max()


def test_a_set_is_made_and_read(tmp_path):
    make(tmp_path / "set", seed=103, kinds={"control": 2}, family="foreign")
    for k in (1, 2):
        assert (tmp_path / "set" / "sealed" / f"case-{k:04d}.json").is_file()
    assert numbers(None, {"outside": 1, "double": 1}, "foreign") == {"outside": 1, "double": 1}


@pytest.mark.parametrize("protocol", ["two-radii", "force-steps"])
def test_a_test_under_a_tool_is_written_as_a_dataset(tmp_path, monkeypatch, protocol):
    pytest.importorskip("skfem")
    monkeypatch.setattr(tool_cases, "FLAT_FINENESS", 0.25)
    case = family.draw(np.random.default_rng(105), CaseRequest("control", (f"tool: {protocol}",), 0.01))
    write(case, tmp_path / "case", "case-0001")
    dataset = read_dataset(tmp_path / "case")
    assert len(dataset.curves) == 2
    assert "C10_Pa" not in (tmp_path / "case" / "dataset.toml").read_text()
