"""Tests of the beam against closed forms.  Each tolerance is derived where it is used.

E = 6 C10 (the law P = 2 C10 (lam - lam^-2) has the slope 6 C10 at lam = 1), G = 2 C10, k = 5/6.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import curve_fit

from studies.moving.geometrically_exact_beam import Beam, Marker, Model, simulate, static

# slender (h/L = 1/50), first period 0.196 s; steps of 1 ms: period error (w dt)^2/12 = 9e-5
SLENDER = Beam(0.2, 0.01, 0.004, 1000.0, 1e8 / 6, dt_s=1e-3)
# soft, first period about 0.13 s: the case for which the solver is meant
SOFT = Beam(0.065, 0.02, 0.008, 1070.0, 115e3, 60e3, gravity_z_m_per_s2=-9.81)
TIP = [(SLENDER.length_m, 0.0)]


def sections(b):
    """EI, kGA, mass per length."""
    area = b.width_m * b.height_m
    return (6 * b.c10_pa * b.width_m * b.height_m**3 / 12, 5 / 6 * 2 * b.c10_pa * area, b.density_kg_per_m3 * area)


def omega1(b):
    ei, _, mu = sections(b)
    return 1.8751041**2 * np.sqrt(ei / (mu * b.length_m**4))


def small_force(b, ratio=1e-3):
    return ratio * 3 * sections(b)[0] / b.length_m**2


def ring(b, end=2.0, markers=TIP, from_s=0.0):
    """Amplitude, decay rate, angular frequency, mean of the first marker's dz by a least-squares fit.

    Higher modes (2 % of the amplitude at a suddenly applied tip load) are nearly orthogonal to the fit.
    """
    t = np.linspace(from_s, end, 1500)
    w = simulate(b, markers, t)[:, 0, 1]
    mean = static(b, markers)[0, 1]
    guess = (-mean, 0.5, omega1(b), 0.0, mean)

    def model(t, a, d, o, phase, c):
        return a * np.exp(-d * t) * np.cos(o * t + phase) + c

    return curve_fit(model, t, w, guess, maxfev=20000)[0][[0, 1, 2, 4]]


def first_frequency(b, markers=()):
    m = Model(b, markers)
    z, loads = np.zeros(m.ndof), (0.0, 0.0, 1.0, None)
    k, mass = m.tangent(z, z, z, (1, 0, 0), loads), m.tangent(z, z, z, (0, 0, 1), loads)
    return np.sqrt(np.min(np.abs(np.linalg.eigvals(np.linalg.solve(mass, k)))))


# ---------------------------------------------------------------- static


def test_small_tip_load_bends_and_shears():
    # the nodes are exact for a linear beam; left is the geometry, (w/L)^2 = 1e-6: 1e-5
    b = replace(SLENDER, height_m=0.03)
    f = small_force(b)
    ei, kga, _ = sections(b)
    u = static(replace(b, tip_force_z_n=f), [(0.2, 0.0), (0.2, 0.015), (0.2, 0.0, 0.03, 0.02), (0.07, 0.0)])
    assert u[0, 1] == pytest.approx(f * 0.2**3 / (3 * ei) + f * 0.2 / kga, rel=1e-5)
    turn = f * 0.2**2 / (2 * ei)  # of the tip; a point off the axis moves with it, second order 1e-3
    assert u[1, 0] - u[0, 0] == pytest.approx(-0.015 * turn, rel=2e-3)
    assert u[2, 0] - u[0, 0] == pytest.approx(-0.02 * turn, rel=2e-3)
    assert u[2, 1] - u[0, 1] == pytest.approx(0.03 * turn, rel=2e-3)
    x = 0.07  # within an element (4.9 of 14), where a term of l^3 is left: 1e-3
    assert u[3, 1] == pytest.approx(f * x**2 * (0.6 - x) / (6 * ei) + f * x / kga, rel=1e-3)


def test_own_weight():
    # the transverse part: 1e-5 as above; axial strain 4e-7 makes the fibre law linear: 1e-5
    ei, kga, mu = sections(SLENDER)
    q = -0.1 * mu
    u = static(replace(SLENDER, gravity_z_m_per_s2=-0.1), TIP)[0]
    assert u[1] == pytest.approx(q * 0.2**4 / (8 * ei) + q * 0.2**2 / (2 * kga), rel=1e-5)
    u = static(replace(SLENDER, gravity_x_m_per_s2=0.2), TIP)[0]
    assert u[0] == pytest.approx(1000 * 0.2 * 0.2**2 / (2 * 1e8), rel=1e-5)


def test_uniform_stretch_is_the_yeoh_law():
    # exact: the fibre stress is uniform
    b = replace(SLENDER, c10_pa=1e5, c20_pa=4e4)
    lam = 1.5
    p = 2 * (lam - lam**-2) * (1e5 + 2 * 4e4 * (lam**2 + 2 / lam - 3))
    u = static(replace(b, tip_force_x_n=p * 0.01 * 0.004), TIP)[0]
    assert u == pytest.approx([0.5 * 0.2, 0.0], abs=1e-9)


def bent_by_moment(b, angle):
    """A follower force along the tip section's normal, 1e6 L off the axis: the moment EI angle / L."""
    moment, arm = sections(b)[0] * angle / b.length_m, 1e6 * b.length_m
    return replace(b, tip_offset_z_m=arm, tip_force_x_n=-moment / arm, tip_force_follower=True)


def tip_rotation(b):
    # difference of two points 1 mm apart on the tip section's normal
    a, c = static(b, [(b.length_m, 0.0), (b.length_m, 0.001)])
    d = c - a + [0.0, 0.001]
    return np.arctan2(-d[0], d[1]) % (2 * np.pi)


@pytest.mark.parametrize("ratio", [0.0, 0.5])
def test_tip_moment_gives_a_circle(ratio):
    # Fibre law: P/(2 C10) = 3 e - 3 e^2 + (4 + 18 r) e^3, r = C20/C10, e = e0 - z kappa.  N = 0 gives
    # e0 = (kappa h)^2/12, then M = EI kappa (1 + (kappa h)^2 (1/30 + 0.9 r)).  So the bending is not
    # quite linear even for C20 = 0.  At half a circle and h/L = 1/50 kappa h = 0.0628: 1.3e-4 for r = 0,
    # 1.9e-3 for r = 0.5; the next order is (kappa h)^4 = 1.6e-5.
    b = bent_by_moment(replace(SLENDER, c20_pa=ratio * SLENDER.c10_pa), np.pi)
    k2 = (np.pi / 50) ** 2
    angle = tip_rotation(b)
    assert angle == pytest.approx(np.pi * (1 - k2 * (1 / 30 + 0.9 * ratio)), abs=3e-4)
    length = 0.2 * (1 + k2 / 12)  # of the stretched axis
    expected = length * np.array([np.sin(angle), 1 - np.cos(angle)]) / angle - [0.2, 0.0]
    # polygon of 14 nodes with arcs of kappa l = 0.22: (kappa l)^4/1920 = 1e-6
    assert static(b, TIP)[0] == pytest.approx(expected, abs=2e-5 * 0.2)


def test_thick_section_stiffens_in_bending_as_derived():
    # same formula with h/L = 1/8: kappa h = 0.39, 0.51 % less rotation; next order 0.02/30 of it: 10 %
    b = bent_by_moment(replace(SLENDER, height_m=0.025), np.pi)
    k2 = (np.pi / 8) ** 2
    assert 1 - tip_rotation(b) / np.pi == pytest.approx(k2 / 30, rel=0.1)


@pytest.mark.parametrize("load, w, u", [(1, 0.30172, 0.05643), (2, 0.49346, 0.16064), (10, 0.81061, 0.55500)])
def test_elastica_under_dead_tip_load(load, w, u):
    # Mattiasson 1981.  h/L = 1/200: shear adds EI/(kGA L^2) 3 = 3e-5, fibre law (kappa h)^2/30 < 1e-5,
    # mesh 1e-6 at load 1 and 6e-6 at load 10; one unit of the table's last digit 3e-5..2e-4: 5e-4
    b = replace(SLENDER, height_m=0.001)
    d = static(replace(b, tip_force_z_n=load * sections(b)[0] / 0.04), TIP)[0] / 0.2
    assert d == pytest.approx([-u, w], rel=5e-4)


def test_elastica_under_follower_tip_load():
    # phi = theta - theta(L): phi'' = -(P/EI) cos(phi), phi(L) = phi'(L) = 0, integrated from the tip
    b, load = replace(SLENDER, height_m=0.001), 3.0
    back = solve_ivp(
        lambda s, y: [y[1], -load * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])],
        (0, 1),
        [0.0, 0.0, 0.0, 0.0],
        rtol=1e-10,
        atol=1e-12,
    ).y[:, -1]
    turn = -back[0]  # rotation of the tip; shape in the tip's frame turned by it
    x, z = (np.cos(turn) * back[2] - np.sin(turn) * back[3], np.sin(turn) * back[2] + np.cos(turn) * back[3])
    f = load * sections(b)[0] / 0.04
    d = static(replace(b, tip_force_z_n=f, tip_force_follower=True), TIP)[0] / 0.2
    assert d == pytest.approx([x - 1, z], abs=3e-4)


def test_clamp_compliance_adds_to_the_deflection():
    # linear: left is the square of the extra tip rotation 1e-3
    ei, _, _ = sections(SLENDER)
    f = small_force(SLENDER)
    ct, cr, ca = 0.2 * 0.2**3 / (3 * ei), 0.3 * 0.2 / ei, 1e-4
    rigid = replace(SLENDER, tip_force_z_n=f)
    soft = replace(rigid, clamp_transverse_m_per_n=ct, clamp_rotational_rad_per_nm=cr)
    more = static(soft, TIP)[0, 1] - static(rigid, TIP)[0, 1]
    assert more == pytest.approx(f * ct + f * 0.04 * cr, rel=1e-4)
    pull = replace(SLENDER, tip_force_x_n=0.5)
    more = static(replace(pull, clamp_axial_m_per_n=ca), TIP)[0, 0] - static(pull, TIP)[0, 0]
    assert more == pytest.approx(0.5 * ca, rel=1e-9)


def test_weight_of_masses_only_if_asked():
    ei, kga, _ = sections(SLENDER)
    mass, x = 1e-4, 0.1  # x is a node (7 of 14)
    b = replace(SLENDER, gravity_z_m_per_s2=-0.1)
    markers = [Marker(x, mass_kg=mass), Marker(0.2)]
    base = static(b, markers)[:, 1]
    assert static(b, [Marker(x), Marker(0.2)])[:, 1] == pytest.approx(base, rel=1e-12)
    assert static(replace(b, tip_mass_kg=1.0), markers)[:, 1] == pytest.approx(base, rel=1e-12)
    p = -mass * 0.1  # the own weight bends by w/L = 7.5e-4: geometry changes the increments by 1e-6
    more = static(replace(b, marker_masses_have_weight=True), markers)[:, 1] - base
    assert more == pytest.approx([p * x**3 / (3 * ei) + p * x / kga, p * x**2 * (0.6 - x) / (6 * ei) + p * x / kga], rel=1e-4)
    more = static(replace(b, tip_mass_kg=mass, tip_mass_has_weight=True), markers)[1, 1] - base[1]
    assert more == pytest.approx(p * 0.2**3 / (3 * ei) + p * 0.2 / kga, rel=1e-4)


# ---------------------------------------------------------------- dynamic


def test_first_frequency():
    # shear and rotary inertia lower it by (h/L)^2 (3.6*4 + 4.7)/24 = 3e-4, steps 9e-5, mesh 1e-5: 1e-3
    b = replace(SLENDER, tip_force_z_n=small_force(SLENDER))
    amplitude, decay, omega, mean = ring(b)
    assert omega == pytest.approx(omega1(b), rel=1e-3)
    assert first_frequency(b) == pytest.approx(omega1(b), rel=1e-3)
    assert abs(decay) < 1e-3 * omega  # no damping of its own (0.1 % of critical)
    # sudden load: the mean is the static value; the first mode holds 97.1 % of it
    assert mean == pytest.approx(1e-3 * 0.2, rel=2e-3)
    assert abs(amplitude) == pytest.approx(0.971 * mean, rel=5e-3)


def test_tip_mass_frequency():
    # Rayleigh with the static shape: 33/140; its error is far below 1 % for m >= m_beam
    ei, _, mu = sections(SLENDER)
    m = 2 * mu * 0.2
    expected = np.sqrt(3 * ei / (0.2**3 * (m + 33 / 140 * mu * 0.2)))
    b = replace(SLENDER, tip_force_z_n=small_force(SLENDER), tip_mass_kg=m)
    assert ring(b)[2] == pytest.approx(expected, rel=1e-2)
    same = replace(SLENDER, tip_offset_z_m=0.01, tip_mass_kg=m)
    assert first_frequency(SLENDER, [Marker(0.2, 0.004, 0.0, 0.006, m)]) == pytest.approx(first_frequency(same), rel=1e-12)


def test_eccentric_tip_mass_turns_about_the_tip():
    # nearly massless beam with a mass at (d, e) from the tip: small motion of the tip (w, turn) with
    # the flexibility [[L^3/3, L^2/2], [L^2/2, L]]/EI.  Vertical motion of the mass w + d turn; sideways
    # -e turn; the axis is stiff.  M = m [[1, d], [d, d^2 + e^2]]; beam mass 1e-4 m: 1e-3
    ei, _, mu = sections(SLENDER)
    m, d, e, ln = 1e4 * mu * 0.2, 0.02, 0.05, 0.2
    flex = np.array([[ln**3 / 3, ln**2 / 2], [ln**2 / 2, ln]]) / ei
    mass = m * np.array([[1, d], [d, d**2 + e**2]])
    expected = 1 / np.sqrt(np.max(np.linalg.eigvals(flex @ mass).real))
    assert first_frequency(SLENDER, [Marker(ln, 0.0, d, e, m)]) == pytest.approx(expected, rel=1e-3)


def test_mass_proportional_damping():
    # decay alpha/2 for every mode; the fit sees 10 periods, 2nd mode residue: 0.5 %
    b = replace(SLENDER, tip_force_z_n=small_force(SLENDER), alpha_per_s=2.0)
    assert ring(b)[1] == pytest.approx(1.0, rel=5e-3)


def test_stiffness_proportional_damping():
    # decay beta w^2/2 with the discrete frequency (w itself 3e-4 low): 0.5 %
    b = replace(SLENDER, tip_force_z_n=small_force(SLENDER), beta_s=2e-3)
    assert ring(b)[1] == pytest.approx(2e-3 * first_frequency(b) ** 2 / 2, rel=5e-3)


def test_linear_drag():
    b = replace(SLENDER, tip_force_z_n=small_force(SLENDER), drag_linear_ns_per_m3=8.0)
    mu = sections(b)[2]
    assert ring(b)[1] == pytest.approx(8.0 * 0.01 / (2 * mu), rel=5e-3)


def test_quadratic_drag():
    # one mode a'' + w^2 a + D |a'| a' = 0: d(1/A)/dt = 4 w D/(3 pi), D = rho Cd b/(2 mu) I3/I2 with
    # I_n = int phi^n dx, phi(tip) = 1.  Other modes carry 3 % of the motion, averaging of the second
    # order (D A)^2 = 1e-3: 2 %
    b = replace(SLENDER, tip_force_z_n=small_force(SLENDER, 0.02), air_density_kg_per_m3=400.0, drag_coefficient=2.0)
    mu = sections(b)[2]
    k, x = 1.8751041, np.linspace(0, 1, 2001)
    s = (np.cosh(k) + np.cos(k)) / (np.sinh(k) + np.sin(k))
    phi = np.cosh(k * x) - np.cos(k * x) - s * (np.sinh(k * x) - np.sin(k * x))
    phi /= phi[-1]
    d = 400 * 2 * 0.01 / (2 * mu) * np.mean(phi**3) / np.mean(phi**2)
    w = omega1(b)
    period = 2 * np.pi / w
    t = np.linspace(0, 10 * period, 4001)
    y = simulate(b, TIP, t)[:, 0, 1] - static(b, TIP)[0, 1]
    top = np.flatnonzero((np.abs(y[1:-1]) > np.abs(y[:-2])) & (np.abs(y[1:-1]) >= np.abs(y[2:]))) + 1
    slope = np.polyfit(t[top], 1 / np.abs(y[top]), 1)[0]
    assert slope == pytest.approx(4 * w * d / (3 * np.pi), rel=0.02)


def test_prony_relaxation():
    # one mode with the modulus 1 - g/(1 + s tau): (s^2 + w0^2) (1 + s tau) = g w0^2, whose complex roots
    # are -decay +- i w.  Steps 1e-4, second mode in the fit: 0.5 % of the decay
    g, tau = 0.08, 0.04
    b = replace(SLENDER, tip_force_z_n=small_force(SLENDER), prony_g=g, prony_tau_s=tau)
    w0 = first_frequency(SLENDER)
    root = max(np.roots([tau, 1, tau * w0**2, (1 - g) * w0**2]), key=lambda s: s.imag)
    # from 0.3 s on the creep of the mean (time constant tau/(1-g)) is over
    _, decay, omega, mean = ring(b, end=2.0, from_s=0.3)
    assert omega == pytest.approx(root.imag, rel=1e-3)
    assert decay == pytest.approx(-root.real, rel=5e-3)
    # long-term sag: 1/(1 - g) of the instantaneous
    sag = static(b, TIP, long_term=False)[0, 1] / (1 - g)
    assert mean == pytest.approx(sag, rel=1e-3)
    assert static(b, TIP)[0, 1] == pytest.approx(sag, rel=1e-5)


def test_prony_large_bending_settles_at_the_long_term_equilibrium():
    b = replace(SOFT, prony_g=0.3, prony_tau_s=0.05, alpha_per_s=15.0, beta_s=2e-3, dt_s=1e-3)
    markers = [(0.065, 0.004), (0.03, -0.004)]
    # slowest: relaxation and exp(-alpha t/2) = 5e-7 at 2 s
    assert simulate(b, markers, [2.0])[0] == pytest.approx(static(b, markers), abs=1e-5 * 0.065)


def test_release_ramp():
    # linear oscillator after a ramp of t_r: residual amplitude |sin(pi t_r/T)/(pi t_r/T)| of the static
    # value; T/2 gives 2/pi, T gives 0.  Second mode (2 %) times its own factor < 0.05: 1 %
    b = replace(SLENDER, tip_force_z_n=small_force(SLENDER))
    period = 2 * np.pi / first_frequency(b)
    for ratio, factor in ((0.5, 2 / np.pi), (1.0, 0.0)):
        t = np.linspace(ratio * period, 4 * period, 800)
        w = simulate(replace(b, release_s=ratio * period), TIP, t)[:, 0, 1] / 2e-4
        assert np.ptp(w) / 2 == pytest.approx(0.971 * factor, abs=0.015)


def test_late_tip_load_is_the_same_motion_later():
    # a step ends at the start of the load (13.37 steps), so only the steps' phase differs
    b = replace(SLENDER, tip_force_z_n=small_force(SLENDER, 0.1))
    t = np.linspace(0, 0.5, 101)
    late = simulate(replace(b, load_start_s=0.01337), TIP, np.r_[0.01, t + 0.01337])
    assert np.all(late[0] == 0)
    assert late[1:] == pytest.approx(simulate(b, TIP, t), abs=1e-4 * 0.02)


@pytest.mark.parametrize("clamp", [0.0, 1.0])
def test_energy_is_kept(clamp):
    # large undamped motion (tip deflects over 0.2 L) with off-axis masses; algorithmic damping at the
    # first mode is (w dt)^3 and below 1e-4, the rest is in the higher modes: 0.5 % of the peak kinetic
    b = replace(
        SOFT,
        tip_force_z_n=-0.08,
        tip_offset_z_m=0.006,
        tip_mass_kg=1e-3,
        tip_mass_has_weight=True,
        clamp_rotational_rad_per_nm=2.0 * clamp,
        clamp_transverse_m_per_n=0.01 * clamp,
        clamp_axial_m_per_n=0.01 * clamp,
    )
    model = Model(b, [Marker(0.04, 0.004, 0.002, 0.003, 5e-4), Marker(0.065)])
    _, q, v = model.integrate(1.0)
    parts = np.array([model.energy(*qv) for qv in zip(q, v, strict=True)])
    assert model.displacements(q)[:, 1, 1].min() < -0.2 * 0.065
    print(f"range of the energy / peak kinetic: {np.ptp(parts.sum(1)) / parts[:, 0].max():.1e}")
    assert np.ptp(parts.sum(1)) < 5e-3 * parts[:, 0].max()


def test_internal_forces_are_the_derivative_of_the_energy():
    # central differences of step 1e-6: 1e-7
    rng = np.random.default_rng(1)
    m = Model(replace(SOFT, n_elements=3, tip_force_z_n=-0.08, tip_offset_z_m=0.01))
    q, d = rng.normal(size=(2, m.ndof)) * np.tile([0.003, 0.003, 0.1], 4)
    q[:3] = d[:3] = 0
    zero, h = np.zeros(m.ndof), 1e-6
    work = m.residual(q, zero, zero, (1.0, 1.0, 1.0, None)) @ d[3:]
    slope = (sum(m.energy(q + h * d, zero)) - sum(m.energy(q - h * d, zero))) / (2 * h)
    assert work == pytest.approx(slope, rel=1e-7)


def test_rates_are_the_derivatives_in_large_motion():
    # central differences along a random path q + v t + a t^2/2: 1e-6
    rng = np.random.default_rng(2)
    m = Model(replace(SOFT, n_elements=3, beta_s=1.0), [Marker(0.03, 0.004, 0.02, 0.01)])
    q, v, a = rng.normal(size=(3, m.ndof)) * np.tile([0.003, 0.003, 0.3], 4)
    q[:3] = v[:3] = a[:3] = 0
    h = 1e-4
    past, now, soon = (np.array(m.pts.place((q + v * s + a * s * s / 2)[m.edof[:, m.pts.element]])[:2]) for s in (-h, 0, h))
    qe, ve, ae = (x[m.edof[:, m.pts.element]] for x in (q, v, a))
    _, _, j, vectors = m.pts.place(qe)
    assert np.array(m.pts.velocity(ve, j)) == pytest.approx((soon - past) / (2 * h), abs=1e-8)
    exact = np.array(m.pts.acceleration(ve, ae, j, vectors))
    assert exact == pytest.approx((soon - 2 * now + past) / h**2, abs=1e-7)

    # viscous power = sum of (d stress/dt) (d strain/dt)
    def state(s):
        stretch, gamma, kappa = m.strains((q + v * s)[m.edof])[:3]
        return np.c_[stretch[:, None] - kappa[:, None] * m.z, gamma], m.elastic(q + v * s)

    rate = [(b - c) / (2 * h) for b, c in zip(state(h), state(-h), strict=True)]
    power = m.l * np.sum(rate[0] * rate[1] * np.r_[m.w, 1.0])
    viscous = m.internal(q[m.edof], v[m.edof], 0 * v[m.edof], 0.0, None)
    assert np.sum(viscous * v[m.edof]) == pytest.approx(power, rel=1e-6)


def test_it_has_converged():
    # soft beam of 0.13 s with all dissipation: halved elements and a third of the step change < 0.5 % of
    # the peak.  Second order: what is seen is 3/4 (mesh) and 8/9 (steps) of the whole error
    b = replace(
        SOFT,
        beta_s=1e-3,
        prony_g=0.1,
        prony_tau_s=0.1,
        alpha_per_s=0.5,
        air_density_kg_per_m3=1.2,
        drag_coefficient=2.0,
        tip_force_z_n=-0.08,
        load_start_s=0.2,
    )
    t = np.linspace(0, 1, 501)
    markers = [(0.065, 0.0), (0.03, 0.004, 0.001, 0.002)]
    u = simulate(b, markers, t)
    short = t <= 0.7
    fine = simulate(replace(b, n_elements=28, dt_s=b.dt_s / 3), markers, t[short])
    peak = np.linalg.norm(fine, axis=2).max(0)
    error = np.linalg.norm(u[short] - fine, axis=2).max(0) / peak
    assert np.all(error < 5e-3)


def test_bad_input_is_refused():
    with pytest.raises(ValueError):
        replace(SOFT, height_m=0.0)
    with pytest.raises(ValueError):
        replace(SOFT, prony_g=1.0)
    with pytest.raises(ValueError):
        simulate(SOFT, [(0.07, 0.0)], [0.1])
    with pytest.raises(ValueError):
        simulate(SOFT, [(0.06, 0.0)], [-0.1])
    assert simulate(SOFT, [(0.06, 0.0)], [0.0, 0.001]).shape == (2, 1, 2)
