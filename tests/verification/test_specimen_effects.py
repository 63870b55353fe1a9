"""Effects of specimen, contact, boundary, loading and rig: no strength is no effect; exact forms and limits."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from explicitfe.fem.effects import EFFECTS, Effect
from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.solve.equilibrium import Relaxation
from explicitfe.fem.solve.load_outcome import Equilibrium
from explicitfe.simulate.anatomy.specimen import specimen_model

MATERIAL = {"law": "yeoh", "C10_Pa": 191.5, "C20_Pa": 90.6, "poisson": 0.499}
FORCES_N = (0.02, 0.04)


def effect(name: str, **parameters) -> Effect:
    return EFFECTS[name](**parameters)


def body_with(*effects: Effect, tool: dict | None = None, tolerance: float = 1e-6, **specimen) -> Relaxation:
    table = {"radius_mm": 16.0, "height_mm": 10.0, "edge_size_mm": 1.0, "material": MATERIAL, **specimen}
    shape = tool or {"shape": "flat-cylinder", "radius_mm": 6.0}
    body = Relaxation(specimen_model(SpecimenTable(**table), ToolTable(**shape), effects), tolerance)
    body.compile()
    assert isinstance(body.settle(), Equilibrium)
    return body


@cache
def displacements(*effects: Effect, **specimen) -> np.ndarray:
    """Displacements [m] under two forces."""
    body = body_with(*effects, **specimen)
    answers = [body.press(force) for force in FORCES_N]
    assert all(isinstance(point, Equilibrium) for point in answers), answers
    return np.array([point.displacement_m for point in answers])


NOTHING = {
    "compressible": {"poisson": 0.499},
    "layer": {"thickness_mm": 1.0, "ratio": 1.0},
    "stiffness-gradient": {"g": 0.0},
    "friction": {"coefficient": 0.0},
    "adhesion": {"stress_Pa": 0.0},
    "base-slip": {"compliance_mm_kPa": 0.0},
    "tilt": {"angle_deg": 0.0},
    "preload": {"force_N": 0.0},
    "gravity": {"acceleration_m_s2": 0.0},
    "compliance": {"compliance_mm_N": 0.0},
}


@pytest.mark.parametrize("name", list(NOTHING))
def test_no_strength_is_no_effect(name):
    """The same displacements to 1e-12; a layer of ratio 1 has a mesh of its own, so it is compared on that mesh."""
    other = displacements(layer_mm=1.0) if name == "layer" else displacements()
    assert displacements(effect(name, **NOTHING[name])) == pytest.approx(other, rel=1e-12)


def test_base_slip_between_its_limits(record_property):
    """The more the base gives way the deeper the tool; at 1e6 mm/kPa it slides freely, at 1e-4 it is bonded, both to 1e-3."""
    d = [displacements(effect("base-slip", compliance_mm_kPa=c))[1] for c in (1e-4, 1.0, 5.0, 20.0, 1e6)]
    record_property("displacements", d)
    assert (np.diff(d) > 0.0).all()
    assert d[0] == pytest.approx(displacements()[1], rel=1e-3)
    assert d[-1] == pytest.approx(displacements(base="sliding")[1], rel=1e-3)


def test_tilt_is_even(record_property):
    """A tool that leans to either side goes as deep, to the tolerance.

    Displacements count from first touch, of the lower edge: it goes deeper than an upright one, by less than the edge leads it.
    """
    settings = {"symmetry": "half", "edge_size_mm": 1.5, "tolerance": 1e-5}
    d = {angle: displacements(effect("tilt", angle_deg=angle), **settings)[1] for angle in (-4.0, 0.0, 2.0, 4.0)}
    record_property("displacements", d)
    assert d[-4.0] == pytest.approx(d[4.0], rel=1e-4)
    first_touch = 6e-3 * np.sin(np.radians([2.0, 4.0]))
    assert 0.0 < d[2.0] - d[0.0] < first_touch[0] and 0.0 < d[4.0] - d[0.0] < first_touch[1]


def test_a_body_without_a_load_is_at_rest_under_a_tilted_tool():
    """Nothing is relaxed: the residual of no load is rounding, over a load of zero, and the search for rest may never end."""
    for C10_Pa in (193.49393063548413, 200.0):
        table = SpecimenTable(
            radius_mm=16.0, height_mm=10.0, edge_size_mm=2.0, symmetry="half", material=MATERIAL | {"C10_Pa": C10_Pa}
        )
        tool = ToolTable(shape="flat-cylinder", radius_mm=6.0)
        body = Relaxation(specimen_model(table, tool, (effect("tilt", angle_deg=5.0),)), 1.5e-3)
        settled = body.settle()
        assert isinstance(settled, Equilibrium)
        assert settled.iterations == 0 and settled.force_N == 0.0
        assert body.move(1e-4).force_N > 0.0


def test_rig_that_gives_way_is_a_spring_in_series():
    """Under a force the machine reads c F more, exactly; by displacement the tissue gets d - c F and answers as it does there."""
    c = 5.0  # mm/N
    soft = effect("compliance", compliance_mm_N=c)
    assert displacements(soft) == pytest.approx(displacements() + 1e-3 * c * np.array(FORCES_N), rel=1e-5)
    body = body_with(soft)
    read = displacements(soft)[1]
    answer = body.move(read)
    assert isinstance(answer, Equilibrium)
    assert answer.displacement_m == pytest.approx(read, rel=1e-5)
    assert answer.force_N == pytest.approx(FORCES_N[1], rel=1e-4)


def test_preload_moves_the_zero():
    """Displacements count from where the tool bears F0: d(F) - d(F0)."""
    plain = body_with()
    d0, d1 = (plain.press(force).displacement_m for force in FORCES_N)
    body = body_with(effect("preload", force_N=FORCES_N[0]))
    assert body.press(FORCES_N[1]).displacement_m == pytest.approx(d1 - d0, rel=1e-3)


def test_inclusion_adds_the_energy_inside_it(record_property):
    """At a given depth the energy changes with the ratio by the energy inside the ball, to first order (Hellmann and Feynman)."""
    ball = {"radius_mm": 3.0, "depth_mm": 4.0}

    def pressed(ratio: float) -> tuple[float, Relaxation]:
        body = body_with(effect("inclusion", ratio=ratio, **ball), tolerance=1e-7)
        reached = body.move(5e-5)
        assert isinstance(reached, Equilibrium)
        return reached.internal_J + reached.hourglass_J, body

    step = 0.05
    change = (pressed(1.0 + step)[0] - pressed(1.0 - step)[0]) / (2.0 * step)
    _, plain = pressed(1.0)
    mesh, fields = plain.model.mesh, plain.element_fields()
    volumes = np.empty(len(plain.volumes))
    volumes[plain.element_order] = plain.volumes
    share = (
        np.asarray(effect("inclusion", ratio=2.0, **ball).apply(plain.model).stiffness) / np.asarray(plain.model.stiffness) - 1.0
    )
    inside = plain.model.copies * float(np.sum(share * volumes * fields["strain_energy_density"]))
    record_property("change_over_energy", change / inside)
    assert share.min() >= 0.0 and share.max() == 1.0 and len(share) == len(mesh.hexes)
    assert plain.model.copies * float(np.sum(share * volumes)) == pytest.approx(4.0 / 3.0 * np.pi * 3e-3**3, rel=0.03)
    assert change == pytest.approx(inside, rel=0.02)


def test_a_rounder_edge_is_that_of_a_rounder_tool():
    tool = {"shape": "flat-cylinder", "radius_mm": 6.0}
    rounder = body_with(effect("edge", rounder_mm=0.5), tool=tool | {"edge_radius_mm": 1.0})
    assert rounder.model.tool.edge_radius_m == pytest.approx(1.5e-3)
    plain = body_with(tool=tool | {"edge_radius_mm": 1.5})
    assert rounder.press(0.02).displacement_m == plain.press(0.02).displacement_m


def test_gradient_is_a_stack_of_layers(record_property):
    """Homogeneous compression of a column whose modulus changes with height: strains add up, d = integral of P / E(z) dz.

    At nu = 0 and a strain of 1e-3, E(z) = E (1 + g (1 - 2 z / H)) gives d = F H ln((1 + g) / (1 - g)) / (2 g E A). The second
    order in strain is 1e-3, and the elements' constant modulus misses the integral by the square of their number: 2 %.
    """
    g = 0.5
    table = {"base": "sliding", "material": MATERIAL | {"poisson": 0.0, "C20_Pa": 0.0}, "tool": {"shape": "platen"}}
    body = body_with(effect("stiffness-gradient", g=g), **table)
    answer = body.move(1e-5)
    area, E = np.pi * 0.016**2, 2.0 * 2.0 * 191.5
    expected = answer.force_N * 0.010 * np.log((1.0 + g) / (1.0 - g)) / (2.0 * g * E * area)
    record_property("ratio", answer.displacement_m / expected)
    assert answer.displacement_m == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("share", [0.8, 1.25])
def test_block_held_by_friction_alone(share, record_property):
    """A block on ice under a rough platen, pulled sideways by a share of mu N: below 1 friction holds it, above it slides away.

    Coulomb's block on an incline, with the tool as the incline. Where it is held, the friction of all points is the pull, to 1 %;
    where it is not, there is no equilibrium to find.
    """
    mu, force = 0.3, 0.02
    table = {"size_mm": (10.0, 10.0, 5.0), "symmetry": "whole", "base": "sliding", "edge_size_mm": 1.7, "material": MATERIAL}
    volume, density = 10e-3 * 10e-3 * 5e-3, 1040.0
    pull = share * mu * force
    table["gravity_m_s2"] = (pull / (volume * density), 0.0, 0.0)
    model = specimen_model(SpecimenTable(**table), ToolTable(shape="platen", friction=mu))
    held = model.held.copy()
    held[:, :2] = False  # nothing but the tool holds it sideways
    body = Relaxation(replace(model, held=held))
    body.compile()
    answer = body.press(force)
    if share > 1.0:
        assert not isinstance(answer, Equilibrium)
        return
    assert isinstance(answer, Equilibrium), answer
    friction = -body.contact.touch(body.state.u)[2][:, 0].sum()
    record_property("friction over pull", friction / pull)
    assert friction == pytest.approx(pull, rel=1e-2)
