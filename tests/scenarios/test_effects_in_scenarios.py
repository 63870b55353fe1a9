"""Every effect is switched on from a scenario: it changes the curve the way it should, or is refused with one sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command import command
from support import ROOT

import explicitfe
from explicitfe.fem.effects import EFFECTS, Measurement
from explicitfe.simulate.scenario.effects_table import EffectsTable

pytestmark = pytest.mark.slow

REAR, VOWEL = ROOT / "scenarios" / "indentation-rear.toml", ROOT / "scenarios" / "vowel-i.toml"
ELASTIC_VOWEL = ROOT / "scenarios" / "vowel-i-gerard-2005.toml"
QUICK = ("model.symmetry=sector", "model.edge_size_mm=1.5", "analysis.forces_N=[0.1, 0.3, 0.1]")

# An effect, and what it does to the displacements at 0.1 N, at 0.3 N, and at 0.1 N on the way back: -1 less, 0 the same, +1 more.
CHANGES = {
    "viscoelastic": ("{g=[0.4, 0.0, 0.0], tau_s=[1.0, 1.0, 1.0]}", (1, 1, 1)),
    "softening": ("{inverse_r=0.5, m_Pa=10.0}", (0, 0, 1)),
    "third-yeoh": ("{C30_Pa=500.0}", (0, -1, 0)),
    "fibres": ("{k1_Pa=5000.0, direction=[1.0, 0.0, 0.0]}", (-1, -1, -1)),
    "compressible": ("{poisson=0.45}", (1, 1, 1)),
    "drainage": ("{share=0.99, tau_s=0.5}", (1, 1, 1)),
    "layer": ("{thickness_mm=2.0, ratio=3.0}", (-1, -1, -1)),
    "stiffness-gradient": ("{g=0.3}", (1, 1, 1)),
    "friction": ("{coefficient=0.3}", (-1, -1, 0)),
    "adhesion": ("{stress_Pa=1.0}", (0, 0, 0)),
    "base-slip": ("{compliance_mm_kPa=20.0}", (1, 1, 1)),
    "tilt": ("{angle_deg=4.0}", (1, 1, 1)),
    "preload": ("{force_N=0.05}", (-1, -1, -1)),
    "gravity": ("{}", (-1, -1, -1)),
    "compliance": ("{compliance_mm_N=1.0}", (1, 1, 1)),
    "power-law": ("{exponent=0.2, tau_s=1.0}", (1, 1, 1)),
    "fractional": ("{g=0.5, alpha=0.3, tau_s=1.0}", (1, 1, 1)),
    "permanent-set": ("{modulus_Pa=200.0}", (0, 0, 1)),
    "payne": ("{modulus_Pa=200.0, yield_shear=0.05}", (-1, -1, 1)),
    "inclusion": ("{ratio=3.0, radius_mm=5.0, depth_mm=8.0}", (-1, -1, -1)),
    "edge": ("{rounder_mm=3.0}", (1, 1, 1)),
    "discovered-law": ("{tau_s=[0.0], c10_Pa=[100.0]}", (-1, -1, -1)),
}
# Effects that are compiled together, each with no strength: further combinations cost a compilation, and the first is that of
# tests/verification/test_effects.py. Without a strength they change nothing, which is tested there.
TOGETHER = (
    {
        "viscoelastic": "{g=[0.0, 0.0, 0.0], tau_s=[1.0, 1.0, 1.0]}",
        "softening": "{inverse_r=0.0, m_Pa=10.0}",
        "third-yeoh": "{C30_Pa=0.0}",
        "fibres": "{k1_Pa=0.0}",
        "drainage": "{share=0.0, tau_s=0.5}",
    },
    {"permanent-set": "{modulus_Pa=0.0}", "payne": "{modulus_Pa=0.0, yield_shear=0.05}"},
)
# Muscles have no part in a test of a specimen, and the exponent of a relaxation none without the relaxation.
ELSEWHERE = {"activation-lag", "nonlinear-relaxation"}


def displacements(tmp_path: Path, *settings: str) -> np.ndarray:
    summary = explicitfe.run(REAR, tmp_path, settings=[*QUICK, *settings], overwrite=True)
    assert summary["status"] == "finished", summary["message"]
    return np.array([point["displacement_mm"] for point in summary["curve"]])


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    """Displacements without an effect."""
    return displacements(tmp_path_factory.mktemp("plain"))


def test_every_effect_is_in_the_table() -> None:
    assert [field.alias for field in EffectsTable.model_fields.values()] == list(EFFECTS)
    measured = {name for name, kind in EFFECTS.items() if issubclass(kind, Measurement)}
    assert set(CHANGES) | measured | ELSEWHERE == set(EFFECTS)
    for kind in EFFECTS.values():
        assert kind.about.title and kind.about.equation and kind.about.needs and kind.about.plausible > 0.0


@pytest.mark.parametrize("name", list(CHANGES))
def test_effect_changes_the_curve(name: str, plain: np.ndarray, tmp_path: Path) -> None:
    """The sign of the change is known from what the effect is; less than 0.3 % counts as none, more as one.

    The third Yeoh term is for large strain; adhesion changes nothing where a flat tool presses, see the next test.
    """
    table, signs = CHANGES[name]
    group = next((group for group in TOGETHER if name in group), {})
    settings = [f"effects.{other}={text}" for other, text in (group | {name: table}).items()]
    changes = displacements(tmp_path, *settings) / plain - 1.0
    for change, sign in zip(changes, signs, strict=True):
        if sign:
            assert sign * change > 3e-3, changes
        elif name != "friction":  # on the way back it may be either
            assert abs(change) < 3e-3, changes


def test_adhesion_at_pull_off(tmp_path: Path) -> None:
    """A platen that sticks pulls with stress x area, no more, and lets go when the gap has passed the reach.

    The body slides on its base, so its top stays flat: pi 8^2 mm^2 x 100 Pa = 0.0201 N at most. The tissue is stretched by
    100 Pa / 1149 Pa of 5 mm, 0.44 mm; with the reach of 1 mm the pull falls slowly enough for every place to be an equilibrium.
    """
    scenario = tmp_path / "pull.toml"
    scenario.write_text(
        """title = "Pull-off"
[model]
name = "specimen"
radius_mm = 8.0
height_mm = 5.0
base = "sliding"
material = { C10_Pa = 191.5, C20_Pa = 90.6 }
[tool]
shape = "platen"
[effects]
adhesion = { stress_Pa = 100.0, reach_mm = 1.0 }
[analysis]
type = "relaxation"
displacements_mm = [0.1, 0.0, -0.2, -0.3, -0.4, -0.5, -0.8, -1.5]
"""
    )
    summary = explicitfe.run(scenario, tmp_path)
    assert summary["status"] == "finished", summary["message"]
    force = np.array([point["force_N"] for point in summary["curve"]])
    largest = 100.0 * np.pi * 0.008**2
    assert force[0] > 0.0 and force.min() >= -largest * (1.0 + 1e-3)
    assert force.min() < -0.9 * largest
    assert force[-1] == 0.0


@pytest.mark.parametrize(
    ("scenario", "setting", "words"),
    [
        (REAR, "effects.viscoelastik={g=[0.3], tau_s=[1.0]}", ["viscoelastik", 'did you mean "viscoelastic"?']),
        (REAR, "effects.viscoelastic={g=[0.6, 0.6], tau_s=[1.0, 2.0]}", ["add up to less than 1"]),
        (REAR, "effects.viscoelastic={g=[0.3], tau=[1.0]}", ["tau", "[effects.viscoelastic]", 'did you mean "tau_s"?']),
        (REAR, "effects.softening={inverse_r=0.5}", ["m_Pa", "missing"]),
        (REAR, "effects.fibres={k1_Pa=1.0, direction=[0.0, 0.0, 0.0]}", ["direction must not be zero"]),
        (REAR, "effects.activation-lag={tau_ms=5.0}", ["activation lag", "muscles"]),
        (REAR, "effects.force-offset={offset_N=0.1}", ["load cell", "predict"]),
        (VOWEL, "effects.friction={coefficient=0.1}", ["friction", "transient"]),
    ],
)
def test_bad_effects(scenario: Path, setting: str, words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["run", str(scenario), "--out", str(tmp_path), "--set", setting]) == 2
    line = next(line for line in capsys.readouterr().err.splitlines() if line.startswith("error:"))
    for word in words:
        assert word in line, line
    assert not list(tmp_path.rglob("*.vtkhdf"))


def test_full_element_knows_no_effects(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    settings = ["--set", "model.element=hex8-full", "--set", "effects.third-yeoh={C30_Pa=1.0}"]
    assert command(["run", str(REAR), "--out", str(tmp_path), *settings]) == 2
    assert "hex8-full" in capsys.readouterr().err


SMALL = ("model.cells=[8,4,4]", "analysis.duration_ms=20")


@pytest.mark.parametrize(
    "setting",
    [
        "effects.viscoelastic={g=[0.3, 0.2], tau_s=[0.01, 0.5]}",
        "model.damping={alpha_per_s=40.0, beta_s=0.03}",
        "effects.activation-lag={tau_ms=10.0}",
    ],
)
def test_effects_in_the_tongue(setting: str, tmp_path: Path) -> None:
    """They run, the balance closes to 1e-3, and the tongue goes less far than it does elastically with a step of force.

    With the first shape: in the thin tip of the second, on this coarse mesh, strains are so large that the loss of finite linear
    viscoelasticity falls below 0 for a while, which its theory does not rule out.
    """
    first = [*SMALL, "model.name=tongue-1"]
    plain = explicitfe.run(ELASTIC_VOWEL, tmp_path, settings=first, overwrite=True)
    summary = explicitfe.run(ELASTIC_VOWEL, tmp_path, settings=[*first, setting], overwrite=True)
    assert summary["status"] == "finished" and summary["energy_balance_error"] < 1e-3
    with explicitfe.open_result(summary["result"]) as result:
        lost = result.history("material_loss")
    if "lag" in setting:
        assert np.all(lost == 0.0)
        assert summary["largest_displacement_mm"] < 0.9 * plain["largest_displacement_mm"]
    else:
        assert lost[-1] > 0.0 and lost.min() >= -1e-3 * lost.max()


def test_lag_is_exact() -> None:
    """tau df/dt + f = c: a step gives 1 - e^(-t / tau), a ramp t - tau (1 - e^(-t / tau)), an end e^(-t / tau) of what was."""
    from dataclasses import replace

    from explicitfe.fem.model.profile import Profile

    tau, t = 0.02, np.linspace(0.0, 0.3, 61)
    step = replace(Profile.step(0.0, 0.1), lag_s=tau).at(t, tolerance_s=1e-9)
    expected = np.where(t <= 0.1, 1.0 - np.exp(-t / tau), (1.0 - np.exp(-0.1 / tau)) * np.exp(-(t - 0.1) / tau))
    assert np.allclose(step, expected, rtol=0.0, atol=1e-14)
    ramp = replace(Profile(np.array([0.0, 0.3]), np.array([0.0, 0.3])), lag_s=tau).at(t, tolerance_s=1e-9)
    assert np.allclose(ramp, t - tau * (1.0 - np.exp(-t / tau)), rtol=0.0, atol=1e-15)
