"""Forces spread over a face: a uniform traction stretches a bar homogeneously, whatever its mesh."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import explicitfe as fe

SIZE_M = (0.03, 0.01, 0.02)
TISSUE = fe.NeoHooke(law="neo-hooke", C10_Pa=300.0, poisson=0.45)


def uneven_box() -> fe.HexMesh:
    """A box whose planes of nodes stand at uneven distances and whose inner nodes are moved at random."""
    mesh = fe.box((4, 3, 3), SIZE_M)
    share = mesh.points / SIZE_M
    points = np.array(SIZE_M) * (0.6 * share + 0.4 * share**2)
    inner = np.all((share > 1e-9) & (share < 1.0 - 1e-9), axis=1)
    points[inner] += np.random.default_rng(3).uniform(-8e-4, 8e-4, (inner.sum(), 3))
    return replace(mesh, points=points)


def test_shares_add_up_to_the_force_and_to_its_moment():
    mesh = uneven_box()
    load = fe.face_load(mesh, "x1", (0.02, -0.01, 0.005))
    assert load.force_N.sum(axis=0) == pytest.approx((0.02, -0.01, 0.005), rel=1e-12)
    centre = (mesh.points[load.nodes] * load.force_N[:, :1]).sum(axis=0) / 0.02
    # a uniform traction acts at the middle of the face; shares of bilinear faces that are rectangles are exact
    assert centre == pytest.approx((SIZE_M[0], SIZE_M[1] / 2, SIZE_M[2] / 2), rel=1e-12)


def test_a_bar_under_traction_is_in_a_homogeneous_state():
    """Uniaxial tension in closed form: the lateral stretch b solves P_22(a, b) = 0, and P_11(a, b) = F / A.

    W = C10 (J^(-2/3) (a^2 + 2 b^2) - 3) + K / 4 (J^2 - 1 - 2 ln J), J = a b^2. The tolerance is that of the relaxation, 1e-8 of
    the load, times the ratio of the stiffest to the softest mode of so few elements (about 1e3).
    """
    mesh = uneven_box()
    C10, K = TISSUE.constants()
    a = 1.2

    def W(a: float, b: float) -> float:
        J = a * b * b
        return C10 * (J ** (-2 / 3) * (a * a + 2 * b * b) - 3.0) + 0.25 * K * (J * J - 1.0 - 2.0 * np.log(J))

    def slope(at, x: float) -> float:
        return (at(x + 1e-6) - at(x - 1e-6)) / 2e-6

    low, high = 0.7, 1.0
    for _ in range(60):  # bisection on dW/db
        b = 0.5 * (low + high)
        low, high = (b, high) if slope(lambda x: W(a, x), b) < 0.0 else (low, b)
    force_N = slope(lambda x: W(x, b), a) * SIZE_M[1] * SIZE_M[2]
    model = fe.Model(
        mesh,
        TISSUE,
        held=mesh.held("x0", along="x") | mesh.held("y0", along="y") | mesh.held("z0", along="z"),
        loads=(fe.face_load(mesh, "x1", (force_N, 0.0, 0.0)),),
    )
    body = fe.Relaxation(model, tolerance=1e-8, threads=1)
    body.settle()
    expected = mesh.points * (a - 1.0, b - 1.0, b - 1.0)
    assert np.abs(body.displacement - expected).max() <= 1e-5 * (a - 1.0) * SIZE_M[0]


def test_a_set_without_a_face_is_refused():
    mesh = fe.box((2, 2, 2), SIZE_M)
    one = replace(mesh, node_sets={"edge": np.array([0, 1])})
    with pytest.raises(fe.InputError, match='"edge" contains no complete face'):
        fe.face_load(one, "edge", (1.0, 0.0, 0.0))
    with pytest.raises(fe.InputError, match='unknown node set "x2"'):
        mesh.held("x2")


def test_a_slender_beam_comes_to_rest():
    """Its residual falls by less than a tenth from one look to the next: that is progress all the same.

    Timoshenko's tip deflection F L^3 / (3 E I) + 1.2 F L / (G A), with E = 3 G. A clamp that keeps the section from narrowing
    stiffens so short a beam by some 4 %, and four elements through the thickness by 2 % more: 8 elements give 0.952
    of the theory, 4 give 0.939.
    """
    length, edge, force_N = 0.05, 0.01, 2e-5
    tissue = fe.Yeoh(C10_Pa=1037.0, C20_Pa=486.0)
    mesh = fe.box((20, 4, 4), (length, edge, edge))
    model = fe.Model(mesh, tissue, held=mesh.held("x0"), loads=(fe.face_load(mesh, "x1", (0.0, 0.0, -force_N)),))
    body = fe.Relaxation(model, threads=1)
    body.settle()
    G = tissue.shear_modulus_Pa
    theory = force_N * length**3 / (3.0 * 3.0 * G * edge**4 / 12.0) + 1.2 * force_N * length / (G * edge**2)
    assert -body.displacement[mesh.node_sets["x1"], 2].mean() == pytest.approx(0.95 * theory, rel=0.03)
