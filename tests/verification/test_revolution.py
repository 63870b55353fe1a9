"""The section of a body of revolution, against closed forms, an independent solver and the relaxation of hexahedra."""

from __future__ import annotations

import numpy as np
import pytest

from explicitfe.fem.effects import EFFECTS, Effect
from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve.equilibrium import Relaxation
from explicitfe.fem.solve.load_outcome import Stuck
from explicitfe.fem.solve.point import uniaxial
from explicitfe.fem.solve.revolution import Revolution, ToolState
from explicitfe.platform.errors import InputError
from explicitfe.simulate.anatomy.specimen import specimen_model

LAW = Yeoh(C10_Pa=200.0, C20_Pa=100.0, poisson=0.499)
SPECIMEN = SpecimenTable(radius_mm=35.0, height_mm=20.0, base="bonded", material="gerard-2005")
PUNCH = ToolTable(shape="flat-cylinder", radius_mm=14.0, edge_radius_mm=1.0)
VISCOELASTIC = EFFECTS["viscoelastic"](g=(0.3,), tau_s=(3.0,))
SOFTENING = EFFECTS["softening"](inverse_r=0.4, m_Pa=20.0)


def moved(body: Revolution, way_mm: np.ndarray, step_s: float = 1.0) -> np.ndarray:
    """Forces [N] at displacements [mm], one after the other."""
    body.settle()
    reached = [body.move(1e-3 * float(d), at_s=step_s * k) for k, d in enumerate(way_mm)]
    assert all(isinstance(one, ToolState) for one in reached), reached
    return np.array([one.force_N for one in reached])


def pressed(body: Revolution, force_N: np.ndarray, step_s: float = 1.0) -> np.ndarray:
    """Displacements [mm] at forces [N], one after the other."""
    body.settle()
    reached = [body.press(float(f), at_s=step_s * k) for k, f in enumerate(force_N)]
    assert all(isinstance(one, ToolState) for one in reached), reached
    return 1e3 * np.array([one.displacement_m for one in reached])


# ---- closed forms ----


@pytest.mark.parametrize("effect", [None, VISCOELASTIC, SOFTENING])
def test_sliding_platens_make_a_homogeneous_state(effect):
    """The response of one point of material; the springs of the contact leave 1e-4 of the strain."""
    specimen = SpecimenTable(radius_mm=10.0, height_mm=10.0, base="sliding", material="gerard-2005")
    effects = [] if effect is None else [effect]
    way = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.0, 2.0, 1.0, 0.5])
    # Both take steps in time, and a load may take several.
    time_s, fine_s = np.arange(len(way), dtype=float), np.linspace(0.0, len(way) - 1.0, 20 * (len(way) - 1) + 1)
    steps = np.interp(fine_s, time_s, way)
    force = moved(Revolution(specimen, ToolTable(shape="platen"), LAW, effects, 0.5), steps, 0.05)
    law = LAW.model_copy(update={"poisson": 0.49999})
    exact = -np.pi * 0.01**2 * uniaxial(law, effects, fine_s, 1.0 - steps / 10.0)
    assert np.abs(force - exact).max() < 1e-3 * exact.max()


def test_a_flat_punch_on_a_half_space():
    """F = 2 E* a d for a sharp rigid punch (Sneddon 1965), E* = 4 E / 3 = 8 C10 without change of volume.

    At a depth of a hundredth of the radius, on a body of a hundred radii. A bonded base at the depth H stiffens the contact by
    about 2 a / H (Hayes et al. 1972, Poisson's ratio 0.5), and the rounding of a fiftieth of the radius lessens the radius of
    contact by 1 %.
    """
    specimen = SpecimenTable(radius_mm=1000.0, height_mm=1000.0, base="bonded", material="gerard-2005")
    tool = ToolTable(shape="flat-cylinder", radius_mm=10.0, edge_radius_mm=0.2)
    (_, force) = moved(Revolution(specimen, tool, LAW), np.array([0.0, 0.1]))
    assert force == pytest.approx(2.0 * 8.0 * 200.0 * 0.01 * 1e-4, rel=0.03)


def test_a_ball_on_a_half_space():
    """F = 4/3 E* R^(1/2) d^(3/2) (Hertz 1882), at a contact radius of a tenth of that of the ball, on 40 radii of contact."""
    specimen = SpecimenTable(radius_mm=60.0, height_mm=60.0, base="bonded", material="gerard-2005")
    body = Revolution(specimen, ToolTable(shape="sphere", radius_mm=10.0), LAW, (), 2.0)
    forces = moved(body, np.array([0.0, 0.1, 0.2]))[1:]
    hertz = 4.0 / 3.0 * 1600.0 * np.sqrt(0.01) * np.array([1e-4, 2e-4]) ** 1.5
    assert forces == pytest.approx(hertz, rel=0.06)


# ---- an independent solver ----

CASES = {
    "elastic": ({}, ()),
    "compressible": ({"poisson": 0.45}, (EFFECTS["compressible"](poisson=0.45, volume_stiffening=0.0),)),
    "nearly incompressible": ({"poisson": 0.48}, (EFFECTS["compressible"](poisson=0.48, volume_stiffening=0.0),)),
    "compressible by far": ({"poisson": 0.4}, (EFFECTS["compressible"](poisson=0.4, volume_stiffening=0.0),)),
    "gradient": ({"gradient": 0.4}, (EFFECTS["stiffness-gradient"](g=0.4),)),
    "layer": ({"layer": (2.0, 3.0)}, (EFFECTS["layer"](thickness_mm=2.0, ratio=3.0),)),
    "slip": ({"base_compliance_mm_kPa": 1.0}, (EFFECTS["base-slip"](compliance_mm_kPa=1.0),)),
    "viscoelastic": ({"prony": ((0.3, 3.0),)}, (VISCOELASTIC,)),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_against_an_independent_axisymmetric_solver(case):
    """Below 0.3 of a noise of 0.01 mm at every row, beyond what the springs of the other solver's contact give way by.

    It is a solver on scikit-fem with other elements, material routines and contact. Its tool sinks in by 1 micrometre for a
    pressure of the shear modulus, which adds the integral of the squared pressure over stiffness and force to the depth.
    """
    from studies.blind.foreign.axisymmetric import Drive, Press, RoundSpecimen
    from studies.blind.foreign.contact import RigidTool
    from studies.blind.foreign.law import HiddenTissue

    hidden, effects = CASES[case]
    press = Press(RoundSpecimen(35.0, 20.0), RigidTool("flat-cylinder", 14.0, 1.0), HiddenTissue(200.0, 100.0, **hidden))
    way = np.linspace(0.0, 3.5, 6)[1:]
    force = np.array([press.advance(float(k + 1), Drive(True, float(d)))[1] for k, d in enumerate(way)])
    body = Revolution(SPECIMEN, PUNCH, LAW, effects)
    body.settle()
    own, springs = np.zeros(len(way)), np.zeros(len(way))
    for k, d in enumerate(way):
        own[k] = body.move(1e-3 * float(d), at_s=float(k + 1)).force_N
        squares = body.section.surface.areas @ body.newton.tractions[:, 1] ** 2
        springs[k] = 1e3 * squares / (1e6 * LAW.shear_modulus_Pa * own[k])  # mm
    stiffness = np.gradient(force, way)
    off = (own - force) / stiffness - springs
    assert np.abs(off).max() < 0.3 * 0.01, 1e3 * off


# ---- the relaxation of hexahedra ----


@pytest.mark.slow
@pytest.mark.parametrize("effect", [None, "friction", "gravity", "preload"])
def test_against_hexahedra(effect):
    """The mesh of hexahedra is 3 % too stiff at this refinement, and ripples by 1 %."""
    effects: list[Effect] = {
        None: [],
        "friction": [EFFECTS["friction"](coefficient=0.3)],
        "gravity": [EFFECTS["gravity"]()],
        "preload": [EFFECTS["preload"](force_N=0.02)],
    }[effect]
    table = SPECIMEN.model_copy(update={"material": LAW, "refinement": 1.0})
    relaxation = Relaxation(specimen_model(table, PUNCH, effects), 2e-4, threads=1)
    relaxation.settle()
    way = np.array([1.0, 2.0, 3.0, 2.0])
    coarse = np.array([relaxation.move(1e-3 * d).force_N for d in way])
    body = Revolution(SPECIMEN, PUNCH, LAW, effects, keeps_volume=False)
    body.settle()
    assert np.array([body.move(1e-3 * d).force_N for d in way]) == pytest.approx(coarse, rel=0.04)


# ---- invariants ----


def test_the_base_bears_the_force_of_the_tool():
    body = Revolution(SPECIMEN, PUNCH, LAW, (), 0.5)
    moved(body, np.array([0.0, 1.0, 2.0]))
    body.newton.evaluate(body.main)
    nodes = body.section.quads.nodes
    forces = np.zeros(len(body.section.points))
    np.add.at(forces, nodes, body.newton.forces[:, 1::2])
    base = body.section.points[:, 1] < 1e-12
    assert forces[base].sum() == pytest.approx(body.main.force, rel=1e-4)


def test_the_work_of_the_tool_is_what_is_stored():
    """On a closed path of an elastic body no work is lost: the force depends on the depth alone."""
    way = np.array([0.0, 1.0, 2.0, 3.0, 2.0, 1.0])
    force = moved(Revolution(SPECIMEN, PUNCH, LAW, (), 0.5), way)
    assert force[[4, 5]] == pytest.approx(force[[2, 1]], rel=1e-4)


def test_a_relaxing_body_loses_force_and_a_softened_one_stiffness():
    """Softening changes nothing in loading, but the substeps of the two runs differ."""
    way = np.array([0.0, 1.0, 2.0, 2.0, 2.0, 1.0])
    elastic, relaxing, softened = (
        moved(Revolution(SPECIMEN, PUNCH, LAW, effects, 0.4), way) for effects in ((), (VISCOELASTIC,), (SOFTENING,))
    )
    assert relaxing[4] < relaxing[3] < relaxing[2] < elastic[2]
    assert softened[1:5] == pytest.approx(elastic[1:5], rel=2e-3) and softened[5] < 0.98 * elastic[5]


def test_a_force_and_its_depth_belong_together():
    force = np.array([0.05, 0.2, 0.4, 0.1])
    depth = pressed(Revolution(SPECIMEN, PUNCH, LAW, (), 0.6), force)
    again = moved(Revolution(SPECIMEN, PUNCH, LAW, (), 0.6), depth)
    assert again == pytest.approx(force, rel=2e-3)


def test_the_compliance_of_the_rig_is_in_series():
    """Both runs solve the same equations, to 1e-6 of the displacement; the difference is a twentieth of it, and more."""
    force = np.array([0.1, 0.3])
    plain, soft = (
        pressed(Revolution(SPECIMEN, PUNCH, LAW, effects, 0.5), force)
        for effects in ((), (EFFECTS["compliance"](compliance_mm_N=0.5),))
    )
    assert soft - plain == pytest.approx(0.5 * force, rel=1e-4)


def test_a_glued_disc_pulls():
    body = Revolution(SPECIMEN, ToolTable(shape="bonded-disc", radius_mm=14.0), LAW, (), 0.5)
    forces = moved(body, np.array([0.0, 0.5, 0.0, -0.5]))
    assert forces[1] > 0.0 > forces[3] and abs(forces[2]) < 1e-6


def test_finer_elements_change_little():
    depths = [pressed(Revolution(SPECIMEN, PUNCH, LAW, (), fineness), np.array([0.2, 0.4])) for fineness in (0.6, 1.2)]
    assert depths[0] == pytest.approx(depths[1], abs=0.003)


# ---- variants ----

VARIED: dict[str, tuple[tuple[Effect, ...], tuple[Effect, ...]]] = {
    "constants": ((), ()),
    "relaxation": ((VISCOELASTIC,), (EFFECTS["viscoelastic"](g=(0.3,), tau_s=(3.005,)),)),
    "layer": ((EFFECTS["layer"](thickness_mm=2.0, ratio=3.0),), (EFFECTS["layer"](thickness_mm=2.01, ratio=3.0),)),
    "friction": ((EFFECTS["friction"](coefficient=0.2),), (EFFECTS["friction"](coefficient=0.2005),)),
}


@pytest.mark.parametrize("name", VARIED)
def test_a_variant_is_a_run_of_its_own(name):
    """The difference to the first tissue is that of two runs, to 5 % of the largest one and 0.08 micrometres.

    Two runs differ by so much because their load steps do.
    """
    effects, others = VARIED[name]
    law = Yeoh(C10_Pa=200.2, C20_Pa=100.0, poisson=0.499) if name == "constants" else LAW
    force = np.array([0.1, 0.2, 0.3, 0.3])
    body = Revolution(SPECIMEN, PUNCH, LAW, effects, 0.5, variants=[(law, others)])
    body.settle()
    together = [body.press(f, at_s=2.0 * k) for k, f in enumerate(force)]
    difference = 1e3 * np.array([one.variants[0][1] - one.displacement_m for one in together])
    alone = [pressed(Revolution(SPECIMEN, PUNCH, *own, 0.5), force, 2.0) for own in ((LAW, effects), (law, others))]
    assert difference == pytest.approx(alone[1] - alone[0], abs=0.05 * np.abs(difference).max() + 8e-5)


def test_a_variant_of_another_kind_is_lost():
    body = Revolution(SPECIMEN, PUNCH, LAW, (), 0.4, variants=[(LAW, (EFFECTS["gravity"](),)), (LAW, (VISCOELASTIC,))])
    body.settle()
    assert body.press(0.1).variants == (None, None)


# ---- refusals ----


def test_a_block_and_a_leaning_tool_are_refused():
    block = SpecimenTable(size_mm=(40.0, 40.0, 20.0), symmetry="quarter", material="gerard-2005")
    with pytest.raises(InputError, match="body of revolution"):
        Revolution(block, PUNCH, LAW)
    with pytest.raises(InputError, match="body of revolution"):
        Revolution(SPECIMEN, PUNCH, LAW, (EFFECTS["tilt"](angle_deg=3.0),))


def test_a_load_that_no_state_carries_is_stuck():
    """A disc that is glued on cannot be pushed through the base."""
    body = Revolution(SPECIMEN, ToolTable(shape="bonded-disc", radius_mm=14.0), LAW, (), 0.4)
    body.settle()
    assert isinstance(body.move(0.03), Stuck)


def test_the_stiffness_of_elements_is_the_derivative_of_their_forces():
    """Against central differences of the forces and of the growth, in a strained state with random disturbances."""
    newton = Revolution(SPECIMEN, PUNCH, LAW, fineness=0.3).newton
    quads, blocks = newton.section.quads, newton.main.blocks
    rng = np.random.default_rng(3)
    size = newton.section.smallest
    r, z = newton.section.points.T
    u = np.column_stack([0.1 * r, -0.15 * z + 0.2 * r * z]).ravel() + 0.01 * size * rng.standard_normal(2 * len(r))
    u[0::2] = np.where(r > 0.0, u[0::2], 0.0)
    pressures = 50.0 * rng.standard_normal(newton.main.pressures.shape)
    forces, growth = np.zeros((len(quads.nodes), 18)), np.zeros((len(quads.nodes), 3))

    def answer(moved):
        assert newton._forces_of(moved, pressures, newton._bulk, quads, blocks, newton.work, forces, growth)
        return forces.copy(), growth.copy()

    arguments = (newton._bulk, quads, blocks, newton.work, forces, growth)
    assert newton._stiffness_of(u, pressures, 1e-6, *arguments, newton._stiffness, newton._coupling, newton._spread)
    stiffness, coupling = newton._stiffness.copy(), newton._coupling.copy()
    step = 1e-5 * size
    for element in rng.integers(0, len(quads.nodes), 4):
        for column in range(18):
            shift = np.zeros_like(u)
            shift[2 * quads.nodes[element, column // 2] + column % 2] = step
            (high, more), (low, less) = answer(u + shift), answer(u - shift)
            own, grown = stiffness[element], coupling[element]
            # Forward differences over 1e-6 are right to about 1e-5.
            assert own[:, column] == pytest.approx((high - low)[element] / (2.0 * step), abs=3e-5 * np.abs(own).max())
            assert grown[column] == pytest.approx((more - less)[element] / (2.0 * step), abs=3e-5 * np.abs(grown).max())


@pytest.mark.parametrize(
    "effects", [(), (EFFECTS["stiffness-gradient"](g=0.6),), (EFFECTS["layer"](thickness_mm=4.0, ratio=0.3),)]
)
def test_symmetric_equations_are_solved_by_cholesky(effects):
    """The step is that of a factorization with pivots; without friction and memory no other is needed."""
    body = Revolution(SPECIMEN, PUNCH, LAW, effects, fineness=0.4)
    pressed(body, np.array([0.05, 0.1]))
    newton, main = body.newton, body.main
    rows = newton.evaluate(main, with_stiffness=True)
    assert newton._symmetric and newton.factorize() and newton._factors[1] is None
    right = np.random.default_rng(1).standard_normal(newton.section.count)
    by_cholesky = newton._solve(*newton._factors[:2], right)
    newton._symmetric = False
    assert rows is not None and newton.factorize() and newton._factors[1] is not None
    by_pivots = newton._solve(*newton._factors[:2], right)
    # Derivatives by differences are symmetric to 2e-5 of the largest; the least stiff direction is some thousand times softer.
    assert by_cholesky == pytest.approx(by_pivots, abs=2e-2 * np.abs(by_pivots).max())


def test_friction_needs_pivots():
    body = Revolution(SPECIMEN, PUNCH.model_copy(update={"friction": 0.3}), LAW, fineness=0.4)
    pressed(body, np.array([0.05, 0.1, 0.2]))
    body.newton.evaluate(body.main, with_stiffness=True)
    assert body.newton.factorize() and body.newton._factors[1] is not None
