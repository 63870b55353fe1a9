"""What no mesh and no state may break: rigid motion, affine fields, momentum, and forces that come from an energy.

On a block of hexes distorted by 15 % and on the built-in tongue, with each material law and each element. Forces are measured in
S = (K + 4 G / 3) h^2, what a strain of one gives; h is the cube root of the mean element volume.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import (
    ELEMENTS,
    IN_RUNS,
    LAWS,
    ONE_POINT,
    TREATMENTS,
    block_mesh,
    deformed,
    elastic_energies,
    force_scale,
    mesh_of,
    model_of,
    random_gradient,
    random_rotation,
    tongue,
)

from explicitfe.fem.elements import hex8
from explicitfe.fem.materials import kinematics, law_of, volumetric
from explicitfe.fem.mesh.hexmesh import CORNERS, HexMesh, shape_functions
from explicitfe.fem.mesh.muscle_lines import Muscle
from explicitfe.fem.model.model import FibrePull, NodalLoad
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.simulate.anatomy.muscles import directed, line_pull
from explicitfe.simulate.scenario.transient import MuscleTable

pytestmark = pytest.mark.slow

BODIES = pytest.mark.parametrize("shape", ["block", "tongue"])
EVERY_LAW = pytest.mark.parametrize("law", list(LAWS))
EVERY_ELEMENT = pytest.mark.parametrize("element", ELEMENTS)
HOURGLASSING = pytest.mark.parametrize("element", ONE_POINT)
# The quadrilateral faces of a hex, seen from outside.
FACES = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])


# ---- rigid motion and affine fields ----


@BODIES
@EVERY_LAW
@EVERY_ELEMENT
def test_rigid_motion_gives_no_force(shape, law, element, record_property):
    """f((R - 1) X + t) = 0 for every rotation R and translation t of up to 10 body sizes L.

    A nodal value of 10 L is rounded by eps/2 10 L; the eight of an element give F an error of about eps 10 L / h, and
    K h^2 times that is the force: eps 10 L / h = 3e-14 for L / h = 15 (the tongue). 1e-12 S leaves room for the sums.
    """
    mesh = mesh_of(shape)
    simulation = Simulation(model_of(mesh, LAWS[law], element=element))
    rng = np.random.default_rng(1)
    half_turns = [Rotation.from_rotvec(np.pi * axis).as_matrix() for axis in np.eye(3)]
    turns = [np.eye(3), *half_turns, *(random_rotation(rng) for _ in range(16))]
    size = np.ptp(mesh.points, axis=0).max()
    worst = 0.0
    for number, R in enumerate(turns):
        shift = rng.standard_normal(3)
        shift *= 10.0 * size * (number % 4 != 0) / np.linalg.norm(shift)
        force = simulation.internal_force(mesh.points @ (R - np.eye(3)).T + shift)
        worst = max(worst, np.abs(force).max() / force_scale(simulation))
    record_property("largest force / S", worst)
    assert worst < 1e-12


def consistent_tractions(mesh: HexMesh, P: np.ndarray) -> np.ndarray:
    """Nodal forces (n, 3) N that hold a body under the uniform stress P: the surface integral of N_a P n dA.

    On a bilinear face the integrand is of degree 2 in each natural coordinate: 2 x 2 Gauss points are exact.
    """
    faces = mesh.hexes[:, FACES].reshape(-1, 4)
    _, index, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    outside = faces[index[count == 1]]
    corners = mesh.points[outside]
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    forces = np.zeros((mesh.node_count, 3))
    for a in (-1.0, 1.0):
        for b in (-1.0, 1.0):
            at = np.array([a, b]) / np.sqrt(3.0)
            factors = 1.0 + at * signs
            along_a = np.einsum("a,fai->fi", 0.25 * signs[:, 0] * factors[:, 1], corners)
            along_b = np.einsum("a,fai->fi", 0.25 * signs[:, 1] * factors[:, 0], corners)
            traction = np.cross(along_a, along_b) @ P.T
            shares = 0.25 * factors.prod(axis=1)
            np.add.at(forces, outside, shares[None, :, None] * traction[:, None, :])
    return forces


def centroid_gradients(corners: np.ndarray) -> np.ndarray:
    """dN_a/dX at the centre of each hex, (m, 8, 3): what a plain one-point rule takes."""
    jacobian = corners.transpose(0, 2, 1) @ (CORNERS / 8.0)
    return (CORNERS / 8.0) @ np.linalg.inv(jacobian)


def gauss_gradients(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """B_aj = (1/V) integral of dN_a/dX_j (m, 8, 3) and V (m,), by the 2 x 2 x 2 Gauss rule.

    The integrand, dN_a/dxi_k times the cofactor of dX/dxi, is of degree 2 or less in each natural coordinate: the rule is exact.
    """
    total = np.zeros(corners.shape)
    for natural in CORNERS / np.sqrt(3.0):
        factors = 1.0 + natural * CORNERS
        dn = np.stack([CORNERS[:, k] * factors[:, (k + 1) % 3] * factors[:, (k + 2) % 3] / 8.0 for k in range(3)], axis=1)
        jacobian = corners.transpose(0, 2, 1) @ dn
        cofactor = np.stack([np.cross(jacobian[:, :, (k + 1) % 3], jacobian[:, :, (k + 2) % 3]) for k in range(3)], -1)
        total += dn @ cofactor.transpose(0, 2, 1)
    volumes = np.sum(corners * total, axis=(1, 2)) / 3.0
    return total / volumes[:, None, None], volumes


def test_mean_gradients_in_closed_form(record_property):
    """The closed form in modes against the Gauss rule, on hexes far from bricks: B = sum_m W_m b_m with six modes, not seven.

    Both are exact; sums of some 50 products round to 50 eps = 1e-14 of the largest.
    """
    corners = np.random.default_rng(3).uniform(-0.3, 0.3, (200, 8, 3)) + CORNERS
    B, V = gauss_gradients(corners)
    closed, volumes = hex8.mean_gradients(corners)
    worst = max(np.abs(closed - B).max() / np.abs(B).max(), np.abs(volumes / V - 1.0).max())
    record_property("off by", worst)
    assert worst < 1e-14


@BODIES
@EVERY_LAW
@EVERY_ELEMENT
def test_patch(shape, law, element, record_property):
    """u = (F0 - 1) X: every element sees F0, the body carries P(F0), and only the surface needs forces, N_a P n dA.

    F = sum_a x_a B_a holds to eps L / h = 3e-15, the stress to K times that. The tolerance of 1e-10 of the largest
    boundary force is 1e4 roundings; the centroid's gradient misses it by 1e7 on the distorted block (also tested).
    """
    mesh = mesh_of(shape)
    simulation = Simulation(model_of(mesh, LAWS[law], element=element))
    module, constants = law_of(law), LAWS[law].constants()
    gradients, volumes = gauss_gradients(mesh.points[mesh.hexes])
    rng = np.random.default_rng(2)
    worst = worst_surface = worst_F = worst_J = worst_hourglass = 0.0
    missed = np.inf
    for _ in range(5):
        F0 = random_rotation(rng) @ random_gradient(rng, 0.2)
        flat, J0 = F0.ravel(), np.linalg.det(F0)
        P = np.array(module.stress(tuple(flat), kinematics.cofactor(tuple(flat)), J0, 0.0, constants)).reshape(3, 3)
        wanted = consistent_tractions(mesh, P)
        largest = np.abs(wanted).max()
        inside = np.abs(wanted).max(axis=1) == 0.0
        assert inside.sum() >= 12
        u = mesh.points @ (F0 - np.eye(3)).T
        force = simulation.internal_force(u)
        worst = max(worst, np.abs(force[inside]).max() / largest)
        worst_surface = max(worst_surface, np.abs(force - wanted).max() / largest)

        F = np.eye(3) + u[mesh.hexes].transpose(0, 2, 1) @ gradients
        worst_F = max(worst_F, np.abs(F - F0).max())
        internal, hourglass_energy = elastic_energies(simulation, u)
        worst_J = max(worst_J, np.abs(simulation.snapshot().J - J0).max())
        worst_hourglass = max(worst_hourglass, abs(hourglass_energy) / internal)

        plain = np.zeros_like(wanted)
        other = volumes[:, None, None] * (centroid_gradients(mesh.points[mesh.hexes]) @ P.T)
        np.add.at(plain, mesh.hexes, other)
        missed = min(missed, np.abs(plain[inside]).max() / largest)
    record_property("largest force inside / largest on the surface", worst)
    record_property("surface forces off by", worst_surface)
    record_property("F off by", worst_F)
    record_property("with the centroid's gradient", missed)
    assert worst < 1e-10
    assert worst_surface < 1e-10
    assert worst_F < 1e-12  # eps L / h, 100 times
    assert worst_J < 1e-12
    # q is rounded by eps L and kappa ~ G h: E / W = (eps L / h)^2 at strains of 0.2
    assert worst_hourglass < 1e-25
    if shape == "block":
        assert missed > 1e-3


# ---- momentum ----


@BODIES
@pytest.mark.parametrize(("law", "element"), IN_RUNS)
def test_momentum_is_conserved(shape, law, element, record_property):
    """A free body keeps p = sum m v_(n+1/2) and l = sum x_n x m v_(n+1/2), over 400 steps, exactly but for rounding.

    v_(n+1/2) - v_(n-1/2) = dt M^-1 f(x_n), and the internal forces have no resultant and no moment about x_n; as
    x_(n+1) = x_n + dt v_(n+1/2), l may as well be taken with x_(n+1), where the loop leaves it. Scales: sum m |v| and
    sum m |x| |v|. 400 steps of rounding on forces of S = m h / dt^2 or less: 400 eps h / (dt |v|) = 1e-11 at the very
    most (h / dt = 40 m/s, |v| = 0.1 m/s), in one direction; 1e-10 is asked for.
    """
    mesh = mesh_of(shape)
    rng = np.random.default_rng(3)
    start = deformed(mesh, rng, 0.15, 0.01, isochoric=True)
    spin = np.cross(rng.uniform(-2.0, 2.0, 3), mesh.points - mesh.points.mean(axis=0))
    velocity = rng.uniform(-0.1, 0.1, start.shape) + spin + rng.uniform(-0.1, 0.1, 3)
    simulation = Simulation(model_of(mesh, LAWS[law], element=element), displacement=start, velocity=velocity)
    dt = 0.8 * simulation.stable_limit(40)
    simulation.start(dt)
    mass = simulation.nodal_mass[simulation.node_order][:, None]
    count = mesh.node_count

    def momenta() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        v = simulation.state.v[:count, :3]
        x = simulation.points + simulation.state.u[:count, :3]
        scales = [np.sum(mass[:, 0] * np.linalg.norm(v, axis=1) * r) for r in (1.0, np.linalg.norm(x, axis=1))]
        return (mass * v).sum(axis=0), np.cross(x, mass * v).sum(axis=0), np.array(scales)

    p0, l0, scales = momenta()
    energy = simulation.snapshot().energies
    p_off = l_off = 0.0
    for _ in range(40):
        assert simulation.advance(10, dt)
        p, angular, _ = momenta()
        p_off = max(p_off, np.abs(p - p0).max() / scales[0])
        l_off = max(l_off, np.abs(angular - l0).max() / scales[1])
    record_property("momentum off by", p_off)
    record_property("angular momentum off by", l_off)
    # The body does vibrate: of the elastic energy of its start a good part has become kinetic or come back.
    assert abs(simulation.snapshot().energies[0] / energy[0] - 1.0) > 0.01
    assert p_off < 1e-10
    assert l_off < 1e-10


@BODIES
@EVERY_LAW
@EVERY_ELEMENT
def test_internal_forces_have_no_moment(shape, law, element, record_property):
    """sum f = 0 and sum x x f = 0 about the current positions x, since the energy does not change under rigid motion.

    Scales sum |f| and sum |x| |f|: the forces of each element cancel to a few eps, and so does their sum; 1e-12.
    """
    mesh = mesh_of(shape)
    simulation = Simulation(model_of(mesh, LAWS[law], element=element))
    rng = np.random.default_rng(4)
    resultant = moment = 0.0
    for _ in range(10):
        u = deformed(mesh, rng)
        force, x = simulation.internal_force(u), mesh.points + u
        size = np.linalg.norm(force, axis=1)
        assert size.max() > 1e-3 * force_scale(simulation)
        resultant = max(resultant, np.abs(force.sum(axis=0)).max() / size.sum())
        moment = max(moment, np.abs(np.cross(x, force).sum(axis=0)).max() / (np.linalg.norm(x, axis=1) @ size))
    record_property("resultant", resultant)
    record_property("moment", moment)
    assert resultant < 1e-12
    assert moment < 1e-12


# ---- forces and energies ----


@EVERY_LAW
@EVERY_ELEMENT
def test_force_is_the_derivative_of_the_energy_everywhere(law, element, record_property):
    """f_i = dE/du_i, E = strain + hourglass energy, by central differences at every degree of freedom of a block.

    Over d = 1e-6 h the truncation error is d^2 f'' / 6 = 1e-12 of K h^2 and the rounding error eps E / d = 2e-16 x 1e-2
    K h^3 / (1e-6 h) = 2e-12 of it; forces at strains of 0.1 are 0.1 K h^2. 1e-7 of the largest force is asked for.
    """
    mesh = block_mesh((2, 2, 2), seed=5)
    simulation = Simulation(model_of(mesh, LAWS[law], element=element))
    rng = np.random.default_rng(5)
    u = deformed(mesh, rng)
    step = 1e-6 * 0.01
    force = simulation.internal_force(u)
    slopes = np.empty_like(force)
    for entry in range(u.size):
        shifted = u.copy()
        shifted.flat[entry] += step
        plus = sum(elastic_energies(simulation, shifted))
        shifted.flat[entry] -= 2.0 * step
        slopes.flat[entry] = (plus - sum(elastic_energies(simulation, shifted))) / (2.0 * step)
    off = np.abs(slopes - force).max() / np.abs(force).max()
    record_property("off by", off)
    assert off < 1e-7


@EVERY_LAW
@EVERY_ELEMENT
def test_force_is_the_derivative_of_the_energy_on_the_tongue(law, element, record_property):
    """f . d = dE(u + s d)/ds for random directions d, on the tongue: as above, 1e-7 of |f| |d|."""
    mesh = mesh_of("tongue")
    simulation = Simulation(model_of(mesh, LAWS[law], element=element))
    rng = np.random.default_rng(6)
    worst = 0.0
    for _ in range(5):
        u, direction = deformed(mesh, rng), rng.standard_normal(mesh.points.shape)
        step = 1e-6 * 0.005 / np.abs(direction).max()
        force = simulation.internal_force(u)
        plus, minus = (sum(elastic_energies(simulation, u + sign * step * direction)) for sign in (1.0, -1.0))
        size = np.linalg.norm(force) * np.linalg.norm(direction)
        worst = max(worst, abs((plus - minus) / (2.0 * step) - np.sum(force * direction)) / size)
    record_property("off by", worst)
    assert worst < 1e-7


def modes_alone(mesh: HexMesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean gradients B (m, 8, 3), volumes (m,) and hourglass vectors g (m, 4, 8), q = g u, in plain numpy."""
    corners = mesh.points[mesh.hexes]
    B, V = gauss_gradients(corners)
    return B, V, hex8.MODES[3:] - (hex8.MODES[3:] @ corners) @ B.transpose(0, 2, 1)


@HOURGLASSING
@EVERY_LAW
def test_hourglass_force_is_the_derivative_of_the_hourglass_energy(law, element, record_property):
    """On a field that leaves F = 1 all force is hourglass force, f_i = dE_h/du_i, E_h = V [W(I1_bar + delta) - W(I1_bar)].

    The field is random, less its affine part: sum_a u_a = 0 and sum_a u_a B_a = 0. The five-point difference over d = 1e-6 m is
    off by d^4 E^(5) / 30: (d / h)^4 = 1e-16 times the derivatives of 1 / |F e|^2, 1e3, over the share d / u of the field. E_h is
    a difference of energies, of which the volume's part, K (d / h)^2 h^3, is rounded by eps: 1e-16 x 1e-8 K h^3 / d against
    G h u: 1e-16 x 500 x 1e-8 h^2 / (d u) = 5e-14. What is left of F - 1 by rounding, 1e-17, loaded with K h^2 against
    G h x 1e-4 h gives 1e-10: below 1e-9.
    """
    mesh = block_mesh((1, 1, 1), seed=7)
    simulation = Simulation(model_of(mesh, LAWS[law], element=element))
    (B,), _, _ = modes_alone(mesh)
    affine, _ = np.linalg.qr(np.column_stack([np.ones(8), B]))
    u = 1e-4 * np.random.default_rng(7).standard_normal((8, 3))
    corners = u[mesh.hexes[0]]
    u[mesh.hexes[0]] = corners - affine @ (affine.T @ corners)
    internal, energy = elastic_energies(simulation, u)
    assert energy > 0.0
    assert abs(internal) < 1e-12 * energy
    force = simulation.internal_force(u)
    slopes = hourglass_slopes(simulation, u, 1e-6)
    off = np.abs(slopes - force).max() / np.abs(force).max()
    record_property("off by", off)
    assert off < 1e-9


def hourglass_slopes(simulation: Simulation, u: np.ndarray, step: float) -> np.ndarray:
    """dE_h/du (n, 3) N by five-point differences."""
    slopes = np.zeros_like(u)
    for entry in range(u.size):
        for shift, weight in ((1.0, 8.0), (-1.0, -8.0), (2.0, -1.0), (-2.0, 1.0)):
            moved = u.copy()
            moved.flat[entry] += shift * step
            slopes.flat[entry] += weight * elastic_energies(simulation, moved)[1] / (12.0 * step)
    return slopes


@HOURGLASSING
@EVERY_LAW
def test_hourglass_part_of_any_state_is_a_derivative(law, element, record_property):
    """f - V P(F, delta = 0) B = dE_h/du at random states of one element, turned, stretched and hourglassing by 30 % of an edge.

    E_h = V [W(I1_bar + delta) - W(I1_bar)] >= 0, with the energy of the barrier where a corner is about to fold, is what the
    snapshot reports, and the force without it is that of F alone, written here in numpy. Five-point differences over
    d = 1e-5 h: truncation 1e-20; rounding eps K h^3 / d = 1e-11 K h^2, or 5e-9 G h^2 where the hourglass forces are 0.1 G h^2
    or more: 1e-7.
    """
    module, constants = law_of(law), LAWS[law].constants()
    rng = np.random.default_rng(71)
    worst = 0.0
    for seed in range(5):
        mesh = block_mesh((1, 1, 1), seed=seed)
        simulation = Simulation(model_of(mesh, LAWS[law], element=element))
        (B,), (V,), _ = modes_alone(mesh)
        F0 = random_rotation(rng) @ random_gradient(rng, 0.3)
        u = mesh.points @ (F0 - np.eye(3)).T + 0.003 * rng.uniform(-1.0, 1.0, (8, 3))
        at = mesh.hexes[0]
        flat = tuple((np.eye(3) + u[at].T @ B).ravel())
        cof = kinematics.cofactor(flat)
        J = kinematics.determinant(flat, cof)
        assert J > 0.1
        force = simulation.internal_force(u)
        force[at] -= V * B @ np.reshape(module.stress(flat, cof, J, 0.0, constants), (3, 3)).T
        assert elastic_energies(simulation, u)[1] > 0.0
        worst = max(worst, np.abs(hourglass_slopes(simulation, u, 1e-7) - force).max() / np.abs(force).max())
    record_property("off by", worst)
    assert worst < 1e-7


def random_state_of_modes(
    element: str, seed: int
) -> tuple[np.ndarray, np.ndarray, tuple[float, ...], Callable[[np.ndarray, np.ndarray], float]]:
    """F (3, 3), q (4, 3) m, the treatment's constants and delta(F, q), of an element distorted and deformed at random."""
    rng = np.random.default_rng(seed)
    mesh = block_mesh((1, 1, 1), seed=seed)
    corners = mesh.points[mesh.hexes]
    treatment = TREATMENTS[element]
    c = tuple(treatment.constants(corners, hex8.geometry(corners))[0])

    def delta(F: np.ndarray, q: np.ndarray) -> float:
        return treatment.invariant(tuple(F.ravel()), *(tuple(q[:, k]) for k in range(3)), c)

    return random_rotation(rng) @ random_gradient(rng, 0.4), 0.01 * rng.standard_normal((4, 3)), c, delta


@HOURGLASSING
@pytest.mark.parametrize("seed", range(10))
def test_hourglass_leaf_is_the_derivative_of_the_invariant(element, seed):
    """``force`` of a treatment gives weight x (d delta/dq, d delta/dF), on floats: two statements, by central differences.

    q is of the size of an edge h, so is F h. Over d = 1e-5 of each: truncation d^2 = 1e-10 times the third derivative, some 10 to
    100, and rounding eps / d = 2e-11: 1e-7 of the largest slope.
    """
    F, q, c, delta = random_state_of_modes(element, seed)
    weight = 0.37
    *r, Q = TREATMENTS[element].force(tuple(F.ravel()), *(tuple(q[:, k]) for k in range(3)), c, weight)
    slopes_q, slopes_F = np.empty((4, 3)), np.empty(9)
    for entry in range(12):
        step = np.zeros(12)
        step[entry] = 1e-7
        step = step.reshape(4, 3)
        slopes_q.flat[entry] = weight * (delta(F, q + step) - delta(F, q - step)) / 2e-7
    for entry in range(9):
        step = np.zeros(9)
        step[entry] = 1e-5
        step = step.reshape(3, 3)
        slopes_F[entry] = weight * (delta(F + step, q) - delta(F - step, q)) / 2e-5
    assert np.abs(slopes_q).max() > 0.0
    assert np.abs(np.transpose(r) - slopes_q).max() < 1e-7 * np.abs(slopes_q).max()
    largest = max(np.abs(slopes_F).max(), weight * delta(F, q))  # a plain stiffness does not depend on F
    assert np.abs(np.array(Q) - slopes_F).max() < 1e-7 * largest
    assert (element == "hex8-stiffness") == (np.abs(slopes_F).max() == 0.0)


@HOURGLASSING
@pytest.mark.parametrize("seed", range(10))
def test_hourglass_invariant_is_objective(element, seed):
    """delta(R F, R q) = delta(F, q) for every rotation R, is positive, and grows as the square of q.

    Some 100 roundings of positive terms: 1e-13. A turn of q alone, or of F alone, changes it where it depends on both.
    """
    F, q, _, delta = random_state_of_modes(element, seed)
    R = random_rotation(np.random.default_rng(seed + 100))
    at_rest = delta(F, q)
    assert at_rest > 0.0
    assert delta(R @ F, q @ R.T) == pytest.approx(at_rest, rel=1e-13)
    assert delta(F, 3.0 * q) == pytest.approx(9.0 * at_rest, rel=1e-13)
    assert delta(F, 0.0 * q) == 0.0
    if element == "hex8":
        assert abs(delta(R @ F, q) / at_rest - 1.0) > 1e-3


@EVERY_ELEMENT
def test_energy_does_not_change_under_a_superposed_rotation(element, record_property):
    """E(R x) = E(x), strain and hourglass energy each, in a state with both.

    F is rounded by eps L / h = 1e-15 and K loads that: 2 eps K |strain| against K strain^2 / 2 at strains of 0.1: 1e-13, and
    as hourglass energy is a difference of such energies the same holds relative to the sum: 1e-12.
    """
    mesh = block_mesh((3, 2, 2), seed=51)
    simulation = Simulation(model_of(mesh, element=element))
    rng = np.random.default_rng(51)
    u = deformed(mesh, rng, 0.2, 0.2)
    before = np.array(elastic_energies(simulation, u))
    assert (before[1] > 1e-3 * before[0]) == (element in ONE_POINT)
    worst = 0.0
    for _ in range(10):
        after = elastic_energies(simulation, (mesh.points + u) @ random_rotation(rng).T - mesh.points)
        worst = max(worst, np.abs(after - before).max() / before.sum())
    record_property("off by", worst)
    assert worst < 1e-12


@EVERY_LAW
def test_stress_of_a_law_is_the_derivative_of_its_energy(law, record_property):
    """P_ij = dW/dF_ij at constant delta on floats, at 50 random F: two statements of the law, compared by central differences.

    d = 1e-6: truncation d^2 = 1e-12 and rounding eps W / d = 1e-16 x 0.1 K / 1e-6 = 1e-11, of K; 1e-7 of the largest
    stress, which is 1e-2 K or more at strains of 0.3, leaves a factor of 100.
    """
    module, constants = law_of(law), LAWS[law].constants()
    rng = np.random.default_rng(8)

    def energy(F: np.ndarray, delta: float) -> float:
        flat = tuple(F.ravel())
        return module.energy(flat, kinematics.determinant(flat, kinematics.cofactor(flat)), delta, constants)

    worst = 0.0
    for number in range(50):
        F = random_rotation(rng) @ random_gradient(rng, 0.3)
        delta = rng.uniform(0.0, 0.5) if number % 2 else 0.0
        flat = tuple(F.ravel())
        cof = kinematics.cofactor(flat)
        J = kinematics.determinant(flat, cof)
        assert pytest.approx(np.linalg.det(F), rel=1e-13) == J
        assert np.allclose(np.reshape(cof, (3, 3)), J * np.linalg.inv(F).T, rtol=1e-13, atol=1e-13)
        P = np.array(module.stress(flat, cof, J, delta, constants)).reshape(3, 3)
        slopes = np.empty((3, 3))
        for entry in range(9):
            plus, minus = F.copy(), F.copy()
            plus.flat[entry] += 1e-6
            minus.flat[entry] -= 1e-6
            slopes.flat[entry] = (energy(plus, delta) - energy(minus, delta)) / 2e-6
        worst = max(worst, np.abs(slopes - P).max() / np.abs(P).max())
        # d/d delta is the slope that the hourglass forces are weighted with
        by_delta = (energy(F, delta + 1e-4) - energy(F, delta - 1e-4)) / 2e-4
        assert by_delta == pytest.approx(module.delta_slope(flat, cof, J, delta, constants), rel=1e-7)
    record_property("off by", worst)
    assert worst < 1e-7


@EVERY_LAW
def test_tangent_leaves_are_derivatives(law):
    """dW = sum of slope_k dI_k by the invariants of the law, and U' = dU/dJ, which the stress stands on.

    Along F = diag(a, a^-1/2, a^-1/2) J = 1, I1_bar = a^2 + 2 / a and I2_bar = 2 a + 1 / a^2, with dI2 / dI1 = 1 / a: at three a
    both slopes have to be right. Central differences over 1e-5: error 1e-10, and rounding 1e-11 of K; 1e-6 of the value and
    1e-10 K are asked for.
    """
    module, constants = law_of(law), LAWS[law].constants()
    count = len(LAWS[law].invariants)

    def on_path(a: float) -> tuple[np.ndarray, float]:
        flat = (a, 0.0, 0.0, 0.0, a**-0.5, 0.0, 0.0, 0.0, a**-0.5)
        return np.array([a * a + 2.0 / a, 2.0 * a + a**-2][:count]), module.energy(flat, 1.0, 0.0, constants)

    d = 1e-5
    for a in (0.6, 1.3, 1.8):
        (high, plus), (low, minus) = on_path(a + d), on_path(a - d)
        invariants, energy = on_path(a)
        slopes = module.slopes_at(tuple(invariants), constants)
        assert len(slopes) == count
        assert plus - minus == pytest.approx(np.dot(slopes, high - low), rel=1e-6)
        assert module.isochoric_at(tuple(invariants), constants) == pytest.approx(energy, rel=1e-9)  # U(1) = 0
    K = constants[-1]
    for J in (0.4, 1.0, 1.7):
        pressure = (volumetric.energy(J + d, K) - volumetric.energy(J - d, K)) / (2.0 * d)
        assert pressure == pytest.approx(volumetric.pressure(J, K), rel=1e-6, abs=1e-10 * K)


@EVERY_LAW
@EVERY_ELEMENT
def test_vector_kernel_equals_floats(law, element, record_property):
    """The law on lanes of the compiled kernel equals the law on floats, put together in plain numpy, on 50 random states.

    One point: f_a = (V P + Q) B_a + sum_k r_k g_k. Eight: f_a = sum_g w_g [P(F_g) + (U'(J_mean) - U'(J_g)) cof F_g] B_ga. The two
    differ in the order of sums, in fused multiply-adds and in the inverse cube root (Newton or power): some 50 roundings of
    terms of up to 5 S (strains of 0.3, eight elements at a node), eps/2 each: 50 x 5 x 1e-16 = 3e-14 S. 9 elements: the last
    block of lanes is not full.
    """
    mesh = block_mesh((3, 3, 1), seed=9)
    simulation = Simulation(model_of(mesh, LAWS[law], element=element))
    of_element = full_forces if element == "hex8-full" else one_point_forces
    rng = np.random.default_rng(9)
    worst = 0.0
    for _ in range(50):
        u = deformed(mesh, rng, 0.3, 0.1)
        wanted = of_element(mesh, u, law, element)
        worst = max(worst, np.abs(simulation.internal_force(u) - wanted).max() / force_scale(simulation))
    record_property("off by", worst)
    assert worst < 3e-14


def one_point_forces(mesh: HexMesh, u: np.ndarray, law: str, element: str) -> np.ndarray:
    """Internal force (n, 3) N of one-point hexes, element by element in numpy, with the leaves on floats."""
    module, constants, treatment = law_of(law), LAWS[law].constants(), TREATMENTS[element]
    B, V, g = modes_alone(mesh)
    numbers = treatment.constants(mesh.points[mesh.hexes], hex8.geometry(mesh.points[mesh.hexes]))
    forces = np.zeros_like(u)
    for e, nodes in enumerate(mesh.hexes):
        flat = tuple((np.eye(3) + u[nodes].T @ B[e]).ravel())
        q = [tuple(column) for column in (g[e] @ u[nodes]).T]
        cof = kinematics.cofactor(flat)
        J = kinematics.determinant(flat, cof)
        c = tuple(numbers[e])
        delta = treatment.invariant(flat, *q, c)
        P = np.reshape(module.stress(flat, cof, J, delta, constants), (3, 3))
        weight = V[e] * module.delta_slope(flat, cof, J, delta, constants)
        *r, Q = treatment.force(flat, *q, c, weight)
        forces[nodes] += B[e] @ (V[e] * P + np.reshape(Q, (3, 3))).T + g[e].T @ np.transpose(r)
    return forces


def full_forces(mesh: HexMesh, u: np.ndarray, law: str, element: str) -> np.ndarray:
    """Internal force (n, 3) N of the fully integrated hex: dN/dX at each Gauss point anew, the law of the element's mean J."""
    module, constants = law_of(law), LAWS[law].constants()
    forces = np.zeros_like(u)
    for nodes in mesh.hexes:
        X = mesh.points[nodes]
        points = []
        for at in CORNERS / np.sqrt(3.0):
            factors = 1.0 + at * CORNERS
            dn = (
                0.125
                * CORNERS
                * np.column_stack([factors[:, [1, 2]], factors[:, [0, 2]], factors[:, [0, 1]]]).reshape(8, 3, 2).prod(axis=2)
            )
            jacobian = X.T @ dn
            B = dn @ np.linalg.inv(jacobian)
            points.append((np.linalg.det(jacobian), B, np.eye(3) + u[nodes].T @ B))
        volume = sum(w for w, _, _ in points)
        mean = sum(w * np.linalg.det(F) for w, _, F in points) / volume
        for w, B, F in points:
            flat = tuple(F.ravel())
            cof = kinematics.cofactor(flat)
            J = kinematics.determinant(flat, cof)
            change = volumetric.pressure(mean, constants[-1]) - volumetric.pressure(J, constants[-1])
            P = np.array(module.stress(flat, cof, J, 0.0, constants)) + change * np.array(cof)
            forces[nodes] += w * B @ P.reshape(3, 3).T
    return forces


# ---- muscles ----

MUSCLES = pytest.mark.parametrize("name", list(tongue().muscles))
DISTRIBUTIONS = pytest.mark.parametrize("distribution", ["ends", "along", "volume"])
FORCE_N = 2.0


def loads_of(name: str, distribution: str, direction: str, side: str = "both") -> NodalLoad | FibrePull:
    table = MuscleTable(name=name, force_N=FORCE_N, distribution=distribution, direction=direction, side=side)
    return directed(tongue().mesh, line_pull(tongue().mesh, tongue().muscles[name], table), table.direction)


def nodal_forces(load: NodalLoad | FibrePull, displacement: np.ndarray) -> np.ndarray:
    """Forces (n, 3) N on the mesh, as the kernels apply them at a displacement."""
    groups = {"loads": (load,)} if isinstance(load, NodalLoad) else {"pulls": (load,)}
    simulation = Simulation(model_of(tongue().mesh, **groups), displacement=displacement)
    return simulation.external_force()


def anchors_of(muscle: Muscle, side: str) -> np.ndarray:
    """Points fixed in space where the fibres of a side end, (k, 3) m; the same one for all fibres of a side."""
    fibres = [fibre for fibre in muscle.fibres if fibre.side == side]
    return np.unique(np.concatenate([f.points.position[f.points.element < 0] for f in fibres]), axis=0)


@MUSCLES
@DISTRIBUTIONS
@pytest.mark.parametrize("direction", ["reference", "following"])
def test_muscles_balance_themselves(name, distribution, direction):
    """A fibre is a chain of segments with opposite forces on their ends: no resultant, no moment about where it lies.

    Fibres that end on a bone outside pull the tongue towards that point: resultant and moment are those of
    T (anchor - first point) / length at the anchors, summed over the fibres. Directions of the reference act at reference
    positions, those that follow at the current ones, also in a deformed state. Nodal forces are sums of up to 100 segment
    forces with shape functions as weights: 100 eps F = 2e-14 F, times the distance from the origin; 1e-12 of F and F |x|.
    """
    mesh, muscle = tongue().mesh, tongue().muscles[name]
    rng = np.random.default_rng(10)
    states = [np.zeros_like(mesh.points)]
    if direction == "following":
        states.append(deformed(mesh, rng, 0.2, 0.2))
    reach = np.linalg.norm(mesh.points, axis=1).max()
    for side in ("left", "right"):
        anchors = anchors_of(muscle, side)
        load = loads_of(name, distribution, direction, side)
        for u in states:
            force, x = nodal_forces(load, u), mesh.points + u
            assert np.abs(force).sum() > 0.1 * FORCE_N
            if not len(anchors):
                assert np.abs(force.sum(axis=0)).max() < 1e-12 * FORCE_N
                assert np.abs(np.cross(x, force).sum(axis=0)).max() < 1e-12 * FORCE_N * reach
                continue
            # The segment in space carries the fibre's share in each of the distributions.
            fibres = [fibre.points for fibre in muscle.fibres if fibre.side == side]
            row = -1 if distribution == "ends" else 1
            partners = np.array([position_in(x, mesh.hexes, points, row) for points in fibres])
            ends = np.array([points.position[0] for points in fibres])
            wanted = FORCE_N / len(fibres) * (ends - partners) / np.linalg.norm(ends - partners, axis=1)[:, None]
            assert np.abs(force.sum(axis=0) - wanted.sum(axis=0)).max() < 1e-12 * FORCE_N
            moment = np.cross(x, force).sum(axis=0) - np.cross(ends, wanted).sum(axis=0)
            assert np.abs(moment).max() < 1e-12 * FORCE_N * reach


def position_in(x, hexes, points, row):
    """The position (3,) of a material point where the nodes are at ``x``."""
    return shape_functions(points.natural[row][None])[0] @ x[hexes[points.element[row]]]


@MUSCLES
@DISTRIBUTIONS
def test_both_directions_agree_at_the_reference(name, distribution):
    """Where nothing has moved, fibres that follow pull as those of fixed direction do: two statements, 1e-12 of F."""
    at_rest = np.zeros_like(tongue().mesh.points)
    fixed = nodal_forces(loads_of(name, distribution, "reference"), at_rest)
    following = nodal_forces(loads_of(name, distribution, "following"), at_rest)
    assert np.abs(fixed - following).max() < 1e-12 * FORCE_N


@MUSCLES
@DISTRIBUTIONS
def test_every_single_fibre_balances_itself(name, distribution):
    """The resultant and the moment of each fibre alone are zero: they do not only cancel in the sum over a muscle."""
    mesh, muscle = tongue().mesh, tongue().muscles[name]
    reach = np.linalg.norm(mesh.points, axis=1).max()
    for fibre in muscle.fibres:
        alone = Muscle.of(name, muscle.title, muscle.max_force_N, (fibre,))
        lines = line_pull(mesh, alone, MuscleTable(name=name, force_N=FORCE_N, distribution=distribution))
        load = directed(mesh, lines, "reference")
        origin = fibre.points.position[0]
        moment = np.cross(mesh.points[load.nodes] - origin, load.force_N).sum(axis=0)
        assert np.abs(moment).max() < 1e-12 * FORCE_N * reach
        if (fibre.points.element >= 0).all():
            assert np.abs(load.force_N.sum(axis=0)).max() < 1e-12 * FORCE_N


@MUSCLES
def test_total_pull_is_the_force_asked_for(name):
    """With ``ends`` the force F is shared equally: each fibre's ends are pulled together by F / fibres, along the chord."""
    muscle = tongue().muscles[name]
    for fibre in muscle.fibres:
        alone = Muscle.of(name, muscle.title, muscle.max_force_N, (fibre,))
        load = directed(tongue().mesh, line_pull(tongue().mesh, alone, MuscleTable(name=name, force_N=FORCE_N)), "reference")
        chord = fibre.points.position[-1] - fibre.points.position[0]
        # Virtual work of a uniform stretch about the origin: sum f . (x - x_0) = -T x length.
        work = np.sum(load.force_N * (tongue().mesh.points[load.nodes] - fibre.points.position[0]))
        assert work == pytest.approx(-FORCE_N * np.linalg.norm(chord), rel=1e-11)
