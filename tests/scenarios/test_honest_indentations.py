"""An indentation that says "finished" is right, or says what is not: energies, forces that were not reached, folded elements."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import ROOT, YEOH, small_indentation

from explicitfe.fem.solve.load_outcome import Equilibrium
from explicitfe.platform.errors import InputError, silent
from explicitfe.results.documents.run_summary import IndentationSummary
from explicitfe.simulate.run.notes import equilibrium_notes
from explicitfe.simulate.run.prepare import prepare
from explicitfe.simulate.run.work import balance_of, external_work

REAR = ROOT / "scenarios" / "indentation-rear.toml"
COARSE = ["model.symmetry=sector", "model.edge_size_mm=1.2"]


def run(folder: Path, *settings: str) -> IndentationSummary:
    analysis = prepare(REAR, [*COARSE, *settings])
    return analysis.run(folder / "x.vtkhdf", overwrite=True, progress=silent)


def by_displacement(*depths_mm: float, **more: object) -> str:
    others = "".join(f", {key}={value}" for key, value in more.items())
    return f'analysis={{type="relaxation", displacements_mm={list(map(float, depths_mm))}{others}}}'


def point(displacement_m: float, force_N: float, **more: float) -> Equilibrium:
    """An equilibrium in a spring that stores all work of a tool, with everything else at zero."""
    zeros = dict.fromkeys(Equilibrium.__dataclass_fields__, 0.0)
    return Equilibrium(**{**zeros, "displacement_m": displacement_m, "force_N": force_N, "reaction_N": force_N, **more})


# ---- the work of the tool ----


def power_law(depths: np.ndarray, exponent: float) -> list[Equilibrium]:
    """F = d^n, which stores d^(n + 1) / (n + 1)."""
    return [point(d, d**exponent, internal_J=d ** (exponent + 1.0) / (exponent + 1.0)) for d in depths]


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0, 3.0])
@pytest.mark.parametrize("loads", [1, 2, 3, 4, 8])
def test_the_doubt_covers_the_error_of_the_work(exponent, loads):
    """Of a plate, a ball, a cone and tissue that stiffens: the work from any number of loads is off by less than its doubt."""
    balance = balance_of(power_law(np.linspace(0.0, 1.0, loads + 1), exponent))
    assert balance.error <= balance.doubt + 1e-12
    if loads == 8:
        assert balance.doubt < 0.01


def test_rests_and_turns_part_the_work_into_stretches():
    """Loaded along d^2, held while the force falls by half, and back along half of it: the work is what was lost, 1/3 - 1/6."""
    down, up = np.linspace(0.0, 1.0, 9), np.linspace(1.0, 0.0, 9)
    curve = [*power_law(down, 2.0), point(1.0, 0.5), point(1.0 + 1e-9, 0.5), *(point(d, 0.5 * d**2) for d in up[1:])]
    work = external_work(curve)
    assert work.work_J == pytest.approx(1.0 / 6.0, abs=1e-8)
    assert work.doubt_J < 1e-3


@pytest.mark.parametrize("loads", ["[0.8]", "[0.4, 0.8]", "[0.4, 0.4]", "[0.8, 0.4, 0.1, 0.0]"])
def test_a_balance_that_few_loads_cannot_tell_is_noted(loads, tmp_path):
    """One load: off by 16 %, and by 100 % with a load given twice, without a word."""
    summary = run(tmp_path, f"analysis.forces_N={loads}")
    assert summary["status"] == "finished"
    assert 1e-3 < summary["energy_balance_error"] <= summary["energy_balance_doubt"]
    assert any("too few to check the energy balance" in note for note in summary["warnings"])
    assert summary["reaction_error"] < 1e-3  # a load that is taken off is no measure; it was 47


def test_enough_loads_need_no_note(tmp_path):
    summary = run(tmp_path, "model.edge_size_mm=0.4", "analysis.forces_N=[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]")
    assert summary["energy_balance_error"] < 1e-3
    assert summary["warnings"] == []


def test_energy_that_is_lost_between_loads_is_noted():
    """A force that snaps down between two loads, as where an element folds: no spline through the loads sees it."""
    curve = power_law(np.linspace(0.0, 1.0, 17), 2.0)
    curve = [p if p.displacement_m < 0.7 else point(p.displacement_m, p.force_N, internal_J=p.internal_J - 0.01) for p in curve]
    (note,) = equilibrium_notes(curve, elastic=True)
    assert "differ by 3" in note and "the state changes abruptly between two loads" in note


# ---- forces ----


def test_a_load_that_is_lost_in_rounding_is_not_reached(tmp_path):
    """It "finished" with a force of 0 N after no iteration."""
    summary = run(tmp_path, "analysis.forces_N=[1e-30]")
    assert summary["status"] == "not-converged" and summary["curve"] == []
    assert "the contact force is 0.000 N instead of" in summary["message"] and "units" in summary["message"]


def test_a_body_that_is_too_stiff_for_a_force():
    """From Python any number was possible; 0 N were an equilibrium."""
    with pytest.raises(InputError, match="C10_Pa = 1e\\+100 is not possible"):
        replace(small_indentation(), material=YEOH.model_copy(update={"C10_Pa": 1e100}))


def test_no_tool_goes_through_the_base():
    """20 mm into 20 mm of tissue "finished", with less force than 19 mm."""
    with pytest.raises(InputError, match="goes 20 mm into 20 mm of tissue, to the rigid base below it"):
        prepare(REAR, [*COARSE, by_displacement(10.0, 20.0)])


def test_elements_that_fold_on_the_way_are_noted(tmp_path):
    """At 0.8 N an element is folded, at the end none: the note was of the end alone."""
    summary = run(tmp_path, 'tool.friction="stick"', "analysis.forces_N=[0.8, 0.4, 0.1]")
    assert summary["folded"]["elements"] == 0
    assert any("inverted at one of the loads, but none at the end" in note for note in summary["warnings"])


def test_a_force_that_falls_while_the_tool_goes_deeper_is_noted():
    curve = [point(0.0, 0.0), point(1e-3, 0.2), point(2e-3, 0.1), point(3e-3, 0.4)]
    notes = equilibrium_notes(curve, elastic=True)
    assert any("the force falls from 0.2 to 0.1 N while the tool goes deeper, from 1 to 2 mm" in note for note in notes)
    assert not any("the force falls" in note for note in equilibrium_notes(curve, elastic=False))
    back = [point(0.0, 0.0), point(1e-3, 0.2), point(0.5e-3, 0.1), point(1e-3, 0.2), point(2e-3, 0.4)]
    assert not any("the force falls" in note for note in equilibrium_notes(back, elastic=True))


def test_a_base_that_carries_another_force_is_noted():
    """Off by 2 % of the largest load, and by 0.5 %, which is no reason."""
    curve = [point(0.0, 0.0), point(1e-3, 0.4, reaction_N=0.384), point(2e-3, 0.8)]
    notes = equilibrium_notes(curve, elastic=True)
    assert any("the base carries up to 0.016 N more or less" in note and "smaller analysis.tolerance" in note for note in notes)
    curve[1] = point(1e-3, 0.4, reaction_N=0.396)
    assert not any("the base carries" in note for note in equilibrium_notes(curve, elastic=True))


def test_a_tool_that_touches_nothing_is_noted():
    (note,) = equilibrium_notes([point(0.0, 0.0), point(1e-3, 0.0)], elastic=True)
    assert note.startswith("the tool touches nothing though it has come down by 1 mm")
