"""Derivatives of a run against differences of runs with the same steps, and against closed forms.

Central differences of step h, extrapolated to fourth order, have an error of order h^4 and rounding of order 1e-16 / h, times
what the motion amplifies: with h = 1e-4 of a value that leaves 1e-9 or less, and 1e-6 is asked for. With contact h is 1e-6: the
force bends where a point touches first, and a difference across such a bend is no derivative.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from support import MOONEY_RIVLIN, NEO_HOOKE, YEOH, block_mesh, model_of, tongue

import explicitfe
from explicitfe.fem.bones.distance import DistanceField
from explicitfe.fem.bones.motion import RigidMotion
from explicitfe.fem.bones.surface import TriangleSurface
from explicitfe.fem.effects.material.viscoelastic import from_damping
from explicitfe.fem.elements import hourglass_stiffness
from explicitfe.fem.materials import law_of
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.mesh.hexmesh import HexMesh, MaterialPoints
from explicitfe.fem.mesh.surface_points import points_on_set
from explicitfe.fem.model.gravity import gravity_load
from explicitfe.fem.model.model import Attachment, Bone, FibrePull, FibreStress, Model, NodalLoad
from explicitfe.fem.model.profile import Profile
from explicitfe.fem.solve.differentiated import Differentiated, check_differentiable
from explicitfe.fem.solve.directions import Direction, inputs_of
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient
from explicitfe.fem.tangent import element
from explicitfe.fem.tangent.arrays import tangents_of
from explicitfe.platform.compiled.arrays import BARRIER, BONE_AREA
from explicitfe.platform.compiled.jit import bind
from explicitfe.platform.compiled.simd import WIDTH
from explicitfe.platform.errors import InputError

change = None  # bound where it is compiled
RELATIVE = 1e-6
H, H_IN_CONTACT = 1e-4, 1e-6  # of a value
STEP_S = 40e-6
BASE = {"C10_Pa": 191.5, "C20_Pa": 90.6, "poisson": 0.45, "stress_Pa": 400.0, "gravity": 1.0, "alpha_per_s": 40.0, "push": 1.0}
RAMP = Profile(np.array([0.0, 0.01]), np.array([0.0, 1.0]))


def muscle(mesh: HexMesh, stress_Pa: float) -> FibreStress:
    """A muscle in all elements with fibres in all directions, which pulls less when it is short."""
    direction = np.random.default_rng(3).normal(size=(mesh.element_count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    return FibreStress("all", np.arange(mesh.element_count), direction, np.full(mesh.element_count, stress_Pa), RAMP, True)


def body(mesh: HexMesh, values: dict[str, float], **more: object) -> Model:
    """A relaxing block under a muscle and gravity: all that the tangents of an element know."""
    law = Yeoh(**{name: values[name] for name in ("C10_Pa", "C20_Pa", "poisson")})
    law, branch = from_damping(law, 0.01, 0.005)
    model = model_of(
        mesh, law, effects=(branch,), alpha_per_s=values["alpha_per_s"], stresses=(muscle(mesh, values["stress_Pa"]),)
    )
    weight = gravity_load(mesh, law, (2.0 * values["gravity"], 0.0, -9.81 * values["gravity"]))
    loads = (weight, *more.pop("loads", ()))
    return replace(model, loads=loads, **more)


def ended(model: Model, duration_s: float, directions: tuple[Direction, ...] = ()) -> Simulation:
    """The body after a run with fixed steps."""
    simulation = Differentiated(model, directions) if directions else Simulation(model, threads=1)
    run = Transient(simulation, duration_s, STEP_S)
    assert run.advance_to(duration_s) is None
    return simulation


def check(
    model_of_values: Callable[[dict[str, float]], Model], keys: tuple[str, ...], duration_s: float, step: float = H
) -> Differentiated:
    """Compare the derivatives of all displacements with differences of runs; give the run with tangents."""

    def at(key: str, value: float) -> Model:
        return model_of_values({**BASE, key: value})

    directions = tuple(Direction(key, BASE[key], lambda x, key=key: at(key, x)) for key in keys)
    simulation = ended(model_of_values(BASE), duration_s, directions)
    for key, tangent in zip(keys, simulation.displacement_changes, strict=True):

        def difference(h: float, key: str = key) -> np.ndarray:
            above, below = (ended(at(key, BASE[key] + sign * h), duration_s).displacement for sign in (1.0, -1.0))
            return (above - below) / (2.0 * h)

        h = step * BASE[key]
        expected = (4.0 * difference(h / 2.0) - difference(h)) / 3.0
        size = np.abs(expected).max()
        assert size > 0.0, key
        assert np.abs(tangent - expected).max() < RELATIVE * size, key
    return simulation


def ball(radius_m: float, centre_m: np.ndarray, motion: RigidMotion | None = None) -> Bone:
    """A smooth bone with the shape of a ball."""
    spacing, cells = 1e-3, 40
    origin = centre_m - 0.5 * spacing * cells
    grid = origin + spacing * np.stack(np.meshgrid(*(np.arange(cells + 1),) * 3, indexing="ij"), axis=-1)
    field = DistanceField(origin, spacing, np.linalg.norm(grid - centre_m, axis=-1) - radius_m)
    nothing = TriangleSurface(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    return Bone("ball", field, nothing, motion=motion, smooth=True)


def test_material_muscles_loads_and_damping() -> None:
    mesh = block_mesh((2, 2, 3))
    ends = MaterialPoints(
        np.array([-1, 5]), np.zeros((2, 3)), np.array([[0.0, 0.0, 0.06], mesh.points[mesh.hexes[5]].mean(axis=0)])
    )

    def model(values: dict[str, float]) -> Model:
        pull = FibrePull("line", (ends,), (np.array([1e-4 * values["push"]]),), RAMP)
        held = np.zeros((mesh.node_count, 3), dtype=bool)
        held[mesh.node_sets["z0"]] = True
        return body(mesh, values, held=held, pulls=(pull,))

    check(model, tuple(BASE), 0.02)


def test_contact_with_a_moving_ball_and_ties_that_give_way() -> None:
    mesh = block_mesh((2, 2, 2))
    points, areas = points_on_set(mesh, "z1")
    tie = Attachment("top", points, areas, 2e5, bone_stiffness_N_m=50.0)
    turn = np.array([0.0, 0.5, 0.0])
    motion = RigidMotion(
        np.array([0.01, 0.01, -0.02]), turn, np.array([1e-3, 0.0, 2e-3]), np.array([0.0, 0.03]), np.array([0.0, 1.0])
    )
    bone = ball(0.012, np.array([0.011, 0.009, -0.0128]), motion)

    def model(values: dict[str, float]) -> Model:
        return body(mesh, values, bones=(bone,), attachments=(tie,))

    simulation = check(model, ("C10_Pa", "stress_Pa", "gravity", "alpha_per_s"), 0.03, H_IN_CONTACT)
    assert simulation.snapshot().contact[0, BONE_AREA] > 0.0


def test_barrier() -> None:
    mesh = block_mesh((2, 2, 2), distort=0.0)
    corner = int(np.argmax(mesh.points.sum(axis=1)))

    def model(values: dict[str, float]) -> Model:
        held = np.zeros((mesh.node_count, 3), dtype=bool)
        held[mesh.node_sets["z0"]] = True
        push = NodalLoad("push", np.array([corner]), -0.025 * values["push"] * np.ones((1, 3)), RAMP)
        return body(mesh, values, held=held, loads=(push,))

    simulation = check(model, ("C10_Pa", "push"), 0.02)
    assert simulation.snapshot().energies[BARRIER] > 0.0


def test_free_fall() -> None:
    """u = g / a (t - (1 - e^(-a t)) / a): central differences are exact to (a dt)^2 / 12 of it."""
    mesh = block_mesh((1, 1, 1))
    none = {**BASE, "stress_Pa": 0.0}

    def model(values: dict[str, float]) -> Model:
        return body(mesh, {**none, **values})

    keys = ("gravity", "alpha_per_s")
    directions = tuple(Direction(key, BASE[key], lambda x, key=key: model({key: x})) for key in keys)
    t, a, g = 0.02, BASE["alpha_per_s"], -9.81
    fall, damped = ended(model({}), t, directions).displacement_changes[:, :, 2]
    by_alpha = g * (-t / a**2 + 2.0 * (1.0 - np.exp(-a * t)) / a**3 - t * np.exp(-a * t) / a**2)
    within = (a * STEP_S) ** 2
    assert fall == pytest.approx(g * (t / a - (1.0 - np.exp(-a * t)) / a**2), rel=within)
    assert damped == pytest.approx(by_alpha, rel=10.0 * within)


def forces_change(u, blocks, tangents):
    """The changes of the internal forces of an element that is bound in place of ``change``."""
    change(u, blocks, tangents)


def test_forces_of_another_law_and_element() -> None:
    """hex8-stiffness and neo-Hooke: random directions in all lanes, and C10 in the first one."""
    mesh = block_mesh((2, 3, 2))

    def model(C10_Pa: float) -> Model:
        return model_of(mesh, NEO_HOOKE.model_copy(update={"C10_Pa": C10_Pa}), element="hex8-stiffness")

    simulation = Simulation(model(191.5), threads=1)
    inputs = inputs_of(simulation, [Direction("C10_Pa", 191.5, model)])
    rows, count = len(simulation.state.u), len(simulation.hexes)
    tangents = tangents_of(simulation.blocks, rows, count, 1, 0, (0, 0), inputs)
    rng = np.random.default_rng(7)
    u, du = 1e-3 * rng.normal(size=(mesh.node_count, 3)), 1e-3 * rng.normal(size=(WIDTH, mesh.node_count, 3))
    simulation.state.u[simulation._place, :3] = u
    for lane, direction in enumerate(du):
        tangents.u[0, simulation._place, :, lane] = direction
    bound = element.kernel_of(law_of("neo-hooke"), hourglass_stiffness, (), False)
    bind(forces_change, change=bound)(simulation.state.u, simulation.blocks, tangents)
    for lane, direction in enumerate(du):

        def force(step: float, C10_Pa: float, direction: np.ndarray = direction) -> np.ndarray:
            return -Simulation(model(C10_Pa), threads=1).internal_force(u + step * direction)

        def difference(h: float, lane: int = lane) -> np.ndarray:
            C10 = 1.0 if lane == 0 else 0.0
            return (force(h, 191.5 + h * C10) - force(-h, 191.5 - h * C10)) / (2.0 * h)

        expected = (4.0 * difference(5e-5) - difference(1e-4)) / 3.0
        assert tangents.force[0, simulation._place, :, lane] == pytest.approx(expected, abs=1e-8 * np.abs(expected).max())


def test_left_and_right_are_mirror_images() -> None:
    mesh = tongue().mesh
    settings = {"model.resolution": "coarse", "bone": [], "analysis.duration_ms": 8.0, "analysis.step_us": 30.0, "muscle": [
        {"name": "HG", "force_N": 0.5, "side": side, "profile": "ramp", "rise_ms": 5.0, "distribution": "stress"}
        for side in ("left", "right")
    ]}  # fmt: skip
    g = explicitfe.gradient("vowel-i", ["muscle.1.force_N", "muscle.2.force_N"], settings=settings)
    left, right = (np.array([course[:, k] for course in g.probe_changes.values()]) for k in range(2))
    assert mesh.named_points.keys() == g.probe_changes.keys()
    assert left == pytest.approx(right * [1.0, -1.0, 1.0], abs=1e-9 * np.abs(left).max())


SMOOTH = {f"bone.{name}.smooth": True for name in ("palate", "jaw", "pharynx")}
SHORT = {"model.resolution": "coarse", "analysis.duration_ms": 12.0, "analysis.step_us": 30.0, **SMOOTH}


def test_tongue_against_runs(tmp_path) -> None:
    """A run of a scenario that touches its bones: keys and measures by their names."""
    keys = ["muscle.GGp.force_N", "muscle.SL.force_N", "model.material.C10_Pa"]
    of = ["points.tip.up_mm", "highest.up_mm", "body.volume_change_percent", "points.back.largest_mm"]
    g = explicitfe.gradient("vowel-i", keys, of, settings=SHORT)
    assert g.of == tuple(of) and g.jacobian.shape == (4, 3) and g.at == (1.33, 0.0, 1037.0)

    def measured(force_N: float) -> np.ndarray:
        settings = {**SHORT, "muscle.GGp.force_N": force_N, "muscle.SL.force_N": 0.0, "analysis.threads": 1}
        measures = explicitfe.measure(explicitfe.run("vowel-i", tmp_path, settings=settings, overwrite=True))
        points = measures.points
        return np.array([
            points["tip"].up_mm, measures.highest.up_mm, measures.body.volume_change_percent, points["back"].largest_mm
        ])  # fmt: skip

    h = 1e-4
    expected = (measured(1.33 + h) - measured(1.33 - h)) / (2.0 * h)
    assert g.jacobian[:, 0] == pytest.approx(expected, rel=1e-5)
    assert g.values == pytest.approx(measured(1.33), rel=1e-12)
    assert g.derivative("points.tip.up_mm", "muscle.SL.force_N") > 0.0
    last = g.probe_changes["tip"][-1, :, 2]
    assert 1e3 * last == pytest.approx(g.jacobian[0], rel=1e-12)


@pytest.mark.parametrize(
    ("by", "of", "settings", "words"),
    [
        (["muscle.GGp.rise_ms"], None, SHORT, "changes the course of a load"),
        (["model.damping.beta_s"], None, SHORT, "model.damping.beta_s"),
        (["model.name"], None, SHORT, "has no number"),
        (["muscle.GGp.force_N"] * 2, None, SHORT, "different keys"),
        (["muscle.GGp.force_N"], ["contact.palate.force_N"], SHORT, "no derivative here"),
        (["muscle.GGp.force_N"], ["points.tip.speed_mm_s"], SHORT, "no derivative here"),
        (["muscle.GGp.force_N"], None, {}, "bone.palate.smooth = true"),
        (["muscle.GGp.force_N"], None, {**SHORT, "bone.jaw.friction": 0.2}, "friction"),
        (["muscle.GGp.force_N"], None, {**SHORT, "model.element": "hex8-full"}, "hex8-full"),
    ],
)
def test_refusals(by: list[str], of: list[str] | None, settings: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words.replace(".", r"\.")) as refused:
        explicitfe.gradient("vowel-i", by, of, settings=settings)
    assert str(refused.value).count("\n") == 0


def test_law_of_two_invariants_is_refused() -> None:
    with pytest.raises(InputError, match="no function of I1 alone"):
        check_differentiable(model_of(block_mesh((1, 1, 1)), MOONEY_RIVLIN))
    check_differentiable(model_of(block_mesh((1, 1, 1)), YEOH))
