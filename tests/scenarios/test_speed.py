"""The commands that time this machine and make its code ahead of time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from answers import check_answer
from command import command
from support import ROOT, YEOH, block_mesh

from explicitfe.app.tools import speed
from explicitfe.fem.model.model import Model
from explicitfe.fem.solve.simulation import MANY_ELEMENTS, Simulation
from explicitfe.platform.errors import InputError
from explicitfe.simulate.scenario.read import read_scenario

pytestmark = pytest.mark.slow


def test_bench_says_what_a_step_costs(capsys):
    assert command(["bench", "--elements", "1000", "--json"]) == 0
    figures = check_answer("bench", capsys.readouterr().out)
    assert [(row["elements"], row["element"]) for row in figures["rows"]] == [(1000, "hex8"), (1000, "hex8-stiffness")]
    for row in figures["rows"]:
        assert 5.0 < row["ns"] < 5000.0  # a nanosecond or a microsecond would be another program
    spoken = figures["scenario"]
    duration_s = 1e-3 * read_scenario(ROOT / "scenarios" / "vowel-i.toml")[0].analysis.duration_ms
    assert spoken["hexes"] == 1200 and spoken["real_time_factor"] == pytest.approx(duration_s / spoken["loop_s"])


def test_a_size_that_is_not_there():
    with pytest.raises(InputError, match="no block of 17 elements"):
        speed.bench([17])


def test_after_warmup_nothing_is_compiled():
    """The second time all is there: loading it takes a fraction of a second each, compiling five and more."""
    speed.warm()
    seconds = speed.warm()["seconds"]
    assert list(seconds) == [*speed.USUAL_RUNS, "homogeneous states"]
    assert max(seconds.values()) < 2.0


def test_in_a_large_mesh_the_limiting_element_is_sought_where_it_vibrates():
    """34 x 32 x 32 elements, one of them a third as high: that one, and the bound of the whole mesh says the same."""
    mesh = block_mesh((34, 32, 32), distort=0.0)
    assert mesh.element_count > MANY_ELEMENTS
    flat = mesh.element_count // 2 + 7
    lower, upper = mesh.hexes[flat, :4], mesh.hexes[flat, 4:]
    points = mesh.points.copy()
    points[upper] = points[lower] + (points[upper] - points[lower]) / 3.0
    mesh = replace(mesh, points=points)
    simulation = Simulation(Model(mesh, YEOH, np.zeros((mesh.node_count, 3), dtype=bool)))
    simulation.stable_limit(40)
    assert simulation.limiting_element() == flat == simulation.stable_bound()[1]
