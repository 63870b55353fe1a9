"""Indentation against solutions of others: case A of the references (implicit programs), and layers of linear elasticity.

Case A: cylinder of radius 35 mm and height 20 mm on a rigid base, Yeoh 191.5 / 90.6 Pa, pressed by a flat cylinder of 14 mm
with an edge of 1 mm, or by a bonded disc. The best estimates and their +- are copied here. The curves are not in the repository
(``outside_data.py``): without them their test is skipped.
"""

from __future__ import annotations

from functools import cache

import layers
import numpy as np
import pytest
from outside_data import SHARED_DATA, needs
from scipy.interpolate import CubicSpline

from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.solve.equilibrium import Relaxation
from explicitfe.fem.solve.load_outcome import Equilibrium
from explicitfe.simulate.anatomy.specimen import specimen_model

LOADS = np.arange(1, 9) / 10.0  # N
REFERENCES = SHARED_DATA / "reference" / "indentation"
# mm at LOADS; reference/README.md of the shared data, "Indentation, case A"
PUNCH_mm = np.array([1.0858, 2.0737, 2.9664, 3.7635, 4.4785, 5.1117, 5.6707, 6.1831])
PUNCH_DOUBT_mm = np.array([0.002, 0.004, 0.006, 0.010, 0.012, 0.016, 0.027, 0.030])
SOFTER_mm = np.array([1.1152, 2.1232, 3.0316, 3.8442, 4.5671, 5.2062, 5.7749, 6.3088])
DISC_mm = np.array([0.929, 1.747, 2.458, 3.079, 3.619, 4.131, 4.562, 4.945])
DISC_DOUBT_mm = np.array([0.001, 0.001, 0.003, 0.008, 0.009, 0.035, 0.038, 0.036])
# the rows of the disc behind its best estimate, at 0.4, 0.2 and 0.1 mm at the edge
DISC_ROWS_mm = np.array(
    [
        [0.9190, 1.7265, 2.4248, 3.0287, 3.5544, 4.0166, 4.4270, 4.7950],
        [0.9244, 1.7370, 2.4398, 3.0487, 3.5809, 4.0507, 4.4694, 4.8460],
        [0.9268, 1.7421, 2.4481, 3.0614, 3.5973, 4.0767, 4.5009, 4.8823],
    ]
)
# name -> shape of the tool, Poisson's ratio, best estimate and its +- (mm)
CASES = {
    "punch": ("flat-cylinder", 0.499, PUNCH_mm, PUNCH_DOUBT_mm),
    "punch, nu = 0.49": ("flat-cylinder", 0.49, SOFTER_mm, 0.005 * SOFTER_mm),
    "disc": ("bonded-disc", 0.499, DISC_mm, DISC_DOUBT_mm),
}
EVERY_CASE = pytest.mark.parametrize("case", list(CASES))


def material(poisson: float, C20_Pa: float = 90.6) -> dict:
    return {"law": "yeoh", "C10_Pa": 191.5, "C20_Pa": C20_Pa, "poisson": poisson}


def case_a(shape: str, poisson: float, *, friction: float | str = 0.0, tolerance: float = 1e-4, **specimen) -> Relaxation:
    """Case A, at rest; by default the sector and the mesh that a scenario gets."""
    table = SpecimenTable(radius_mm=35.0, height_mm=20.0, material=material(poisson), **specimen)
    body = Relaxation(specimen_model(table, ToolTable(shape=shape, radius_mm=14.0, friction=friction)), tolerance)
    assert isinstance(body.settle(), Equilibrium)
    return body


@cache
def curve(case: str, refinement: float = 1.0, symmetry: str = "sector", friction: float | str = 0.0) -> tuple[Equilibrium, ...]:
    shape, poisson, *_ = CASES[case]
    body = case_a(shape, poisson, refinement=refinement, symmetry=symmetry, friction=friction)
    points = tuple(body.press(float(load)) for load in LOADS)
    assert all(isinstance(point, Equilibrium) for point in points), points[-1]
    return points


def displacements_mm(*case) -> np.ndarray:
    return 1e3 * np.array([point.displacement_m for point in curve(*case)])


# ---- case A ----


@EVERY_CASE
def test_case_a_on_the_default_mesh(case, record_property):
    """Within 1.5 % and the reference's own +- of its best estimate at each of eight loads."""
    *_, wanted, doubt = CASES[case]
    d = displacements_mm(case)
    record_property("off by %", np.round(100.0 * (d / wanted - 1.0), 2).tolist())
    assert (np.abs(d - wanted) < 0.015 * wanted + doubt).all()


@EVERY_CASE
def test_case_a_on_a_finer_mesh(case, record_property):
    """Elements half as large: within the larger of 0.5 % and +-.

    Of the disc at 0.5 N 0.6 % is allowed: the best estimate is too low there, see
    ``test_best_estimate_of_the_disc_at_half_a_newton``.
    """
    *_, wanted, doubt = CASES[case]
    allowed = np.maximum(0.005 * wanted, doubt)
    if case == "disc":
        allowed[4] = 0.006 * wanted[4]
    d = displacements_mm(case, 2.0)
    record_property("off by %", np.round(100.0 * (d / wanted - 1.0), 2).tolist())
    record_property("share of what is allowed", np.round(np.abs(d - wanted) / allowed, 2).tolist())
    assert (np.abs(d - wanted) < allowed).all()


def test_best_estimate_of_the_disc_at_half_a_newton(record_property):
    """The reference's best estimate of the disc is not smooth in the load around 0.5 N; its own rows and our curve are.

    Each displacement against a cubic spline through all the others: a smooth curve is off by the spline's error, some 0.01 % in
    the middle as the rows at 0.4 and 0.2 mm show. The best estimate zigzags by 0.3 to 0.5 % at 0.4, 0.5 and 0.6 N, too low at
    0.5 N by about as much as we lie above it. Beyond that the rows, extrapolated by one order p for all loads,
    v = v3 + (v3 - v2) / (2^p - 1) with p from the sums of all changes, lie above the best estimate at 0.5 N by more than its
    own +-, and on it at 0.6 N; we lie nearer to them there. Hence 0.6 % instead of 0.5 % in ``test_case_a_on_a_finer_mesh``.
    """
    ours = displacements_mm("disc", 2.0)
    changes = np.diff(DISC_ROWS_mm, axis=0)
    ratio = changes[0].sum() / changes[1].sum()
    one_order = DISC_ROWS_mm[2] + changes[1] / (ratio - 1.0)
    record_property("order", np.log2(ratio))
    record_property("one order mm", np.round(one_order, 4).tolist())
    record_property("ours / one order - 1 in %", np.round(100.0 * (ours / one_order - 1.0), 2).tolist())
    record_property("best / one order - 1 in %", np.round(100.0 * (DISC_mm / one_order - 1.0), 2).tolist())
    zigzag = {}
    for name, values in {"best": DISC_mm, "0.4 mm": DISC_ROWS_mm[0], "0.2 mm": DISC_ROWS_mm[1], "ours": ours}.items():
        F, d = np.append(0.0, LOADS), np.append(0.0, values)
        others = [CubicSpline(np.delete(F, k), np.delete(d, k))(F[k]) for k in (4, 5, 6)]
        zigzag[name] = 100.0 * (d[4:7] / others - 1.0)
        record_property(f"{name}: off the others at 0.4, 0.5, 0.6 N by %", np.round(zigzag[name], 3).tolist())
    assert np.abs(zigzag["ours"]).max() < 0.05
    assert np.abs(zigzag["0.2 mm"]).max() < 0.05
    assert np.abs(zigzag["best"]).min() > 0.25
    assert zigzag["best"][1] < -0.4
    assert one_order[4] > DISC_mm[4] + DISC_DOUBT_mm[4]
    assert abs(ours[4] - one_order[4]) < abs(ours[4] - DISC_mm[4])


@needs(REFERENCES)
def test_case_a_curves(record_property):
    """The reference's curves at 0.2 mm, between 0.02 N and 0.8 N, not only at eight loads, by a spline through ours.

    1.5 % and what 0.2 mm is off itself at most: 0.4 % with the flat tool; the disc, which converges slowly, 2 % at 0.8 N.
    """
    files = {"punch": ("A_L2.csv", 0.004), "punch, nu = 0.49": ("A_L2_nu0.49.csv", 0.004), "disc": ("A_bonded_L2.csv", 0.02)}
    for case, (file, doubt) in files.items():
        d_mm, F = np.loadtxt(REFERENCES / file, delimiter=",", skiprows=1).T
        inside = (F > 0.02) & (F <= 0.8)
        ours = CubicSpline(np.append(0.0, LOADS), np.append(0.0, displacements_mm(case)))
        off = ours(F[inside]) / d_mm[inside] - 1.0
        record_property(f"{case}: off by %", (round(100.0 * off.min(), 2), round(100.0 * off.max(), 2)))
        assert np.abs(off).max() < 0.015 + doubt


@EVERY_CASE
def test_case_a_is_in_balance(case, record_property):
    """What was promised of each load: residual, kinetic ratio, the base's reaction, penetration, hourglass share, smallest J.

    Residual <= 1e-4, kinetic ratio <= 1e-8, reaction = force to 1e-3, penetration <= 1e-3 of the indentation, hourglass energy
    <= 5 % of the whole, J > 0.5.
    """
    points = curve(case)
    reaction = [abs(p.reaction_N / load - 1.0) for p, load in zip(points, LOADS, strict=True)]
    sunk = [p.penetration_m / p.displacement_m for p in points]
    share = [p.hourglass_J / (p.internal_J + p.hourglass_J) for p in points]
    record_property("reaction off by", max(reaction))
    record_property("penetration / indentation", max(sunk))
    record_property("hourglass share", max(share))
    record_property("iterations", [p.iterations for p in points])
    assert max(p.residual for p in points) <= 1e-4
    assert max(p.kinetic_ratio for p in points) <= 1e-8
    assert max(reaction) < 1e-3
    if case != "disc":
        assert max(sunk) <= 1e-3
    assert max(share) < 0.05
    assert min(p.smallest_J for p in points) > 0.5


def test_case_a_with_a_tool_that_sticks(record_property):
    """Between the frictionless tool and the bonded disc, at each load; a sticking tool may touch more than the disc does.

    No reference: the figures are stated. A coefficient of 0.3 lies between none and sticking.
    """
    free, disc = displacements_mm("punch"), displacements_mm("disc")
    stick = displacements_mm("punch", 1.0, "sector", "stick")
    some = displacements_mm("punch", 1.0, "sector", 0.3)
    record_property("stick mm", np.round(stick, 4).tolist())
    record_property("0.3 mm", np.round(some, 4).tolist())
    record_property("stick / disc", np.round(stick / disc, 3).tolist())
    assert (stick < free).all()
    assert (some < free).all()
    assert (stick < some * (1.0 + 1e-3)).all()
    assert (stick > 0.9 * disc).all()


# ---- layers of linear elasticity ----

POISSON = 0.499
# The material is E = 2 G (1 + nu), G = 2 C10 + small strain; C20 is made not to matter.
E_Pa = 2.0 * (2.0 * 191.5) * (1.0 + POISSON)


def layer_force(tool: dict, height_mm: float, radius_mm: float, depth_mm: float, **specimen) -> Equilibrium:
    """A bonded layer of linear behaviour under a tool that has come down so far."""
    table = SpecimenTable(radius_mm=radius_mm, height_mm=height_mm, material=material(POISSON, 1e-6), **specimen)
    body = Relaxation(specimen_model(table, ToolTable(**tool)), 1e-4)
    assert isinstance(body.settle(), Equilibrium)
    state = body.move(1e-3 * depth_mm)
    assert isinstance(state, Equilibrium), state
    return state


@pytest.mark.parametrize("height_mm", [20.0, 10.0, 5.0])
def test_flat_punch_on_a_layer(height_mm, record_property):
    """Punch of 5 mm, 0.05 mm deep, on a bonded layer: Hayes et al. (1972), P = 2 E a kappa delta / (1 - nu^2), nu = 0.499, 2 %.

    A rounding of 2 % of the radius lets the contact end within it: it lies between a - e and a, so the force between those of
    Hayes with these radii, 3 to 4 % apart; the force at the largest radius that is seen to be pressed is the reference. The
    rounding costs what lies between that and Hayes with a: 2 to 3 %. The specimen reaches 12 a or 5 h.
    """
    a, depth = 5.0, 0.05
    tool = {"shape": "flat-cylinder", "radius_mm": a, "edge_radius_mm": 0.02 * a}
    state = layer_force(tool, height_mm, max(12.0 * a, 5.0 * height_mm), depth, edge_size_mm=0.05)
    forces = [layers.flat_punch_force(E_Pa, 1e-3 * r, 1e-3 * depth, 1e-3 * height_mm, POISSON) for r in (0.98 * a, a)]
    seen = layers.flat_punch_force(E_Pa, state.contact_radius_m, 1e-3 * depth, 1e-3 * height_mm, POISSON)
    record_property("contact radius / a", 1e3 * state.contact_radius_m / a)
    record_property("off by % (radius pressed, a - e, a)", [round(100.0 * (state.force_N / f - 1.0), 2) for f in (seen, *forces)])
    assert state.force_N == pytest.approx(seen, rel=0.02)
    assert 0.98 * forces[0] < state.force_N < 1.02 * forces[1]


@pytest.mark.parametrize(("height_mm", "depth_mm"), [(20.0, 0.2), (5.0, 0.2), (2.5, 0.1)])
def test_sphere_on_a_layer(height_mm, depth_mm, record_property):
    """Ball of 10 mm on a bonded layer against the integral equation (chi = sqrt(R d) / h = 0.07, 0.28, 0.4), nu = 0.499, 2 %.

    12 edges or more across the contact radius; the specimen reaches 12 a and 5 h. The paraboloid of the reference stands for the
    ball to a^2 / (4 R^2) = 0.5 %, and strains of a / (3 R) = 5 % are nearly linear. Dimitriadis' series is reported, and
    asked to 3 % only where chi < 0.1: it is itself 0.1 % too small at 0.07, 2.5 % at 0.28, 5 % at 0.4.
    """
    R = 10.0
    chi = np.sqrt(R * depth_mm) / height_mm
    a = np.sqrt(R * depth_mm)
    state = layer_force(
        {"shape": "sphere", "radius_mm": R}, height_mm, max(12.0 * a, 5.0 * height_mm), depth_mm, edge_size_mm=a / 12.0
    )
    arguments = E_Pa, 1e-3 * R, 1e-3 * depth_mm, 1e-3 * height_mm
    wanted = layers.sphere_layer_force(*arguments, POISSON)
    series = layers.dimitriadis_force_general(*arguments, POISSON)
    record_property("chi", chi)
    record_property("contact radius / sqrt(R d)", 1e3 * state.contact_radius_m / a)
    record_property(
        "off by % of the equation, of the series", [round(100.0 * (state.force_N / f - 1.0), 2) for f in (wanted, series)]
    )
    record_property("series off by % of the equation", round(100.0 * (series / wanted - 1.0), 2))
    assert state.force_N == pytest.approx(wanted, rel=0.02)
    if chi < 0.1:
        assert state.force_N == pytest.approx(series, rel=0.03)
