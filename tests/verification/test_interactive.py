"""model.speed = "interactive": long steps, little added mass, and nearly the same motion."""

from __future__ import annotations

import numpy as np
import pytest
from support import ROOT, YEOH, block_mesh, model_of

from explicitfe.fem.model.interactive import ADDED_MASS_SHARE, POISSON, let_volume_change, scale_mass
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import TURNS_AT_THE_START, Transient
from explicitfe.simulate.run.prepare import prepare

pytestmark = pytest.mark.slow


def test_the_mass_that_is_added_makes_the_step_longer():
    """A block of cubes with layers of 10 mm and one of 1 mm: 3 % of the mass is added, at the nodes of the thin layer alone.

    The bound of the step is that of a pressure wave; with its mass at the four nodes it must grow, and gravity must not feel it.
    """
    mesh = block_mesh((4, 4, 4), 0.01, distort=0.0)
    points = mesh.points.copy()
    points[np.isclose(points[:, 2], 0.04), 2] = 0.031
    thin = np.flatnonzero(points[:, 2] > 0.029)
    model = model_of(type(mesh)(points, mesh.hexes), YEOH)
    heavier = scale_mass(model)
    (added,) = heavier.masses
    plain, scaled = Simulation(model), Simulation(heavier)
    mass = plain.density @ plain.volumes
    assert added.mass_kg.sum() == pytest.approx(ADDED_MASS_SHARE * mass, rel=1e-6)
    assert set(added.nodes) <= set(thin)
    assert scaled.stable_limit(TURNS_AT_THE_START) > 1.2 * plain.stable_limit(TURNS_AT_THE_START)
    assert heavier.loads == model.loads


def test_tissue_that_changes_its_volume_stays_as_it_is():
    """A Poisson's ratio of 0.3 is below that of the option."""
    soft = YEOH.model_copy(update={"poisson": 0.3})
    assert let_volume_change(model_of(block_mesh((1, 1, 1), 0.01), soft)).material.poisson == 0.3
    assert let_volume_change(model_of(block_mesh((1, 1, 1), 0.01), YEOH)).material.poisson == POISSON


def test_the_tongue_moves_nearly_as_it_does_with_short_steps(record_property):
    """Vowel [i] on the coarse mesh, at 280 ms: within 0.1 mm rms of nodes that move by up to 6 mm, in a third of the steps.

    0.055 mm were measured. A pressure of p changes a length by p / (3 K): 2 kPa and K = 104 kPa instead of 1 MPa give 0.6 % of 20
    mm, 0.12 mm.
    """
    bodies = []
    for speed in ("accurate", "interactive"):
        settings = ["model.resolution=coarse", f"model.speed={speed}"]
        body = prepare(ROOT / "scenarios" / "vowel-i.toml", settings).body
        assert Transient(body, 0.28).advance_to(0.28) is None
        bodies.append(body)
    accurate, interactive = bodies
    difference = np.linalg.norm(interactive.displacement - accurate.displacement, axis=1)
    rms_mm = 1e3 * np.sqrt(np.mean(difference**2))
    record_property("rms / mm", rms_mm)
    assert rms_mm < 0.1
    assert 3 * interactive.steps < accurate.steps
