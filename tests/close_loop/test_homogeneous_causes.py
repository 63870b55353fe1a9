"""Homogeneous tests of other laws, with noise in both columns: their causes are named, with no tool or sensor beside them.

The curves are those of :mod:`studies.blind.foreign.closed`, closed forms and convolution sums that share no code with the
simulator.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from outside_data import SHARED_DATA, needs

from explicitfe.app.api.inverse import close_loop
from explicitfe.fem.effects import cause_of
from studies.blind.foreign.closed import ForeignBench
from studies.blind.grid import HomogeneousRun

pytestmark = pytest.mark.slow

C10_PA, C20_PA, TOP_STRAIN = 250.0, 120.0, 0.35
ROWS = 61
STRESS_SHARE, STRETCH_SD = 0.005, 2e-4
OTHER_PROGRAMS = SHARED_DATA / "other-programs"
# The hidden causes of these sets, as truth.json describes them.
HOMOGENEOUS_SETS = {
    "case-08": {"viscoelastic", "softening"},
    "case-11": {"viscoelastic"},
    "case-12": {"softening"},
    "case-17": {"viscoelastic"},
    "case-32": set(),
}


def fractional_terms(g: float, order: float, tau_s: float) -> dict[str, list[float]]:
    """Prony terms of g E_a(-(t/tau)^a), E_a of Mittag-Leffler, from its spectrum of times (Mainardi 2010, eq. 3.29)."""
    logs = np.linspace(-16.0, 16.0, 97)
    weights = np.sin(np.pi * order) / np.pi / (np.exp(order * logs) + np.exp(-order * logs) + 2.0 * np.cos(np.pi * order))
    return {"g": list(g * weights / weights.sum()), "tau_s": list(tau_s * np.exp(logs))}


TRUTHS = {
    "two Prony terms": ({"viscoelastic": {"g": [0.25, 0.25], "tau_s": [0.8, 14.0]}}, {"viscoelastic"}),
    "a fractional law": ({"viscoelastic": fractional_terms(0.6, 0.4, 3.0)}, {"viscoelastic"}),
    "softening without beta": ({"softening": {"inverse_r": 0.5, "m_Pa": 8.0, "beta": 0.0}}, {"softening"}),
    "softening with beta": ({"softening": {"inverse_r": 0.5, "m_Pa": 8.0, "beta": 0.15}}, {"softening"}),
    "no effect": ({}, set()),
}


def programmes() -> list[HomogeneousRun]:
    """A slow and a fast loop, a ramp with a hold, and two loops of rising height."""
    loop = np.concatenate([np.linspace(0.0, 1.0, 31), np.linspace(1.0, 0.0, 31)[1:]])
    rising = np.interp(np.arange(65), [0, 12, 24, 44, 64], [0.0, 0.6, 0.0, 1.0, 0.0])
    steps = {
        "slow": (60.0, loop),
        "fast": (1.5, loop),
        "hold": (30.0, np.minimum(np.linspace(0.0, 10.0, ROWS), 1.0)),
        "rising": (30.0, rising),
    }
    return [
        HomogeneousRun(name, np.linspace(0.0, last, len(way)), 1.0 + TOP_STRAIN * way, test=number)
        for number, (name, (last, way)) in enumerate(steps.items())
    ]


def write_tests(folder: Path, effects: dict, seed: int = 1) -> Path:
    """The dataset, with noise in stress and in stretch."""
    folder.mkdir()
    rng = np.random.default_rng(seed)
    bench = ForeignBench(programmes(), "uniaxial")
    curves = bench.curves(bench.values(C10_PA, C20_PA, effects))
    sd = STRESS_SHARE * max(float(np.abs(y).max()) for y in curves)
    text = 'format = "explicitfe-dataset/1"\nname = "foreign"\ntitle = "Foreign"\ntest = "tension"\n[specimen]\nshape = "point"\n'
    text += f"[noise]\nstress_sd_Pa = {sd:.6g}\nstretch_sd = {STRETCH_SD:g}\n"
    for run, y in zip(bench.plan, curves, strict=True):
        noisy = run.imposed + STRETCH_SD * rng.standard_normal(len(y)), y + sd * rng.standard_normal(len(y))
        rows = "".join(f"{t:.9g},{x:.9g},{f:.9g}\n" for t, x, f in zip(run.time_s, *noisy, strict=True))
        (folder / f"{run.id}.csv").write_text(f"time_s,stretch,nominal_stress_Pa\n{rows}", encoding="utf-8")
        text += f'[[curve]]\nid = "{run.id}"\nfile = "{run.id}.csv"\nsplit = "fit"\n'
    (folder / "dataset.toml").write_text(text, encoding="utf-8")
    return folder


@pytest.mark.parametrize("name", TRUTHS)
def test_the_causes_of_another_law(name, tmp_path):
    effects, causes = TRUTHS[name]
    report = close_loop(write_tests(tmp_path / "data", effects), processes=1)
    wanted = "effect-found" if causes else "no-missing-effect"
    assert (report.verdict, {cause_of(effect) for effect in report.effects}) == (wanted, causes), report.posterior


@needs(OTHER_PROGRAMS)
@pytest.mark.parametrize(("name", "causes"), HOMOGENEOUS_SETS.items())
def test_the_causes_of_sets_of_other_programs(name, causes):
    report = close_loop(OTHER_PROGRAMS / name, processes=1)
    wanted = "effect-found" if causes else "no-missing-effect"
    assert (report.verdict, {cause_of(effect) for effect in report.effects}) == (wanted, causes), report.posterior
