"""Planar geometrically exact (Simo-Reissner) cantilever of a soft material; numpy and scipy only.

The plane is (x, z): x along the straight, unloaded beam from the clamp at x = 0, z up.  The rotation
theta turns x towards z.  A section point is r(x) + Lambda(theta) (0, z); so the fibre strain is
eps - z kappa with eps = r'.e1 - 1, kappa = theta', gamma = r'.e3.  Sections stay rigid (z is not
changed by the lateral contraction).  SI units throughout.

Elements: 2 nodes, linear r and theta, one point (no shear locking).  The constant curvature of an
element leaves out the bending by the linear part of the moment; its known flexibility l^2/(12 EI)
(MacNeal, EI = 6 C10 b h^3/12) is added to the shear flexibility 1/(5/6 G A): nodes of a linear beam
are then exact.  The chord is made an arc of constant curvature: r' = chord/l (1 + (kappa l)^2/24).
Inertia, weight and drag use two Gauss points in each element and the interpolation which belongs to the
linear theta: w = linear - l/2 xi (1 - xi) (theta2 - theta1).  The clamp's springs are not damped.
Time: generalized-alpha in the form of Arnold and Bruels (2007), equilibrium exact at each step.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline


@dataclass(frozen=True)
class Beam:
    """All parameters; every default is 'absent'."""

    length_m: float
    width_m: float
    height_m: float  # along z
    density_kg_per_m3: float
    c10_pa: float  # Yeoh W = c10 (I1-3) + c20 (I1-3)^2; instantaneous values if prony_g > 0
    c20_pa: float = 0.0
    beta_s: float = 0.0  # stress += beta_s * d(elastic stress)/dt
    prony_g: float = 0.0  # share of the instantaneous stress which relaxes (0 <= g < 1)
    prony_tau_s: float = 1.0
    alpha_per_s: float = 0.0  # mass-proportional, on the beam's own mass only
    drag_linear_ns_per_m3: float = 0.0  # force per length c * b * v_normal
    air_density_kg_per_m3: float = 0.0
    drag_coefficient: float = 0.0  # force per length 0.5 * rho_air * Cd * b * |v_normal| v_normal
    clamp_axial_m_per_n: float = 0.0  # compliances 1/k of the clamp; 0 is rigid
    clamp_transverse_m_per_n: float = 0.0
    clamp_rotational_rad_per_nm: float = 0.0
    gravity_x_m_per_s2: float = 0.0  # acceleration of the weight, e.g. gravity_z = -9.81
    gravity_z_m_per_s2: float = 0.0
    tip_force_x_n: float = 0.0
    tip_force_z_n: float = 0.0
    tip_force_follower: bool = False  # True: the force turns with the tip section
    tip_offset_z_m: float = 0.0  # where the tip force acts and the tip mass sits: (L, e_z)
    tip_mass_kg: float = 0.0
    tip_mass_has_weight: bool = False
    marker_masses_have_weight: bool = False
    load_start_s: float = 0.0  # the tip force is 0 before and full (times the ramp) from here on
    release_s: float = 0.0  # weight and tip force times min(1, t / release_s); 0: at once
    n_elements: int = 14
    n_fibres: int = 6
    dt_s: float = 2.5e-4  # largest step
    rho_inf: float = 0.9  # spectral radius at high frequency

    def __post_init__(self) -> None:
        positive = "length_m width_m height_m density_kg_per_m3 c10_pa prony_tau_s dt_s n_elements n_fibres"
        not_negative = (
            "beta_s alpha_per_s drag_linear_ns_per_m3 air_density_kg_per_m3 drag_coefficient "
            "clamp_axial_m_per_n clamp_transverse_m_per_n clamp_rotational_rad_per_nm "
            "tip_mass_kg load_start_s release_s"
        )
        if not (
            all(getattr(self, name) > 0 for name in positive.split())
            and all(getattr(self, name) >= 0 for name in not_negative.split())
            and 0 <= self.prony_g < 1
            and 0 <= self.rho_inf <= 1
        ):
            raise ValueError(f"needed: positive {positive}; not negative {not_negative}; g < 1; rho_inf <= 1")


@dataclass(frozen=True)
class Marker:
    """Point r(x) + Lambda(theta(x)) ((0, z) + standoff), with an optional point mass there."""

    x_m: float
    z_m: float = 0.0
    standoff_x_m: float = 0.0
    standoff_z_m: float = 0.0
    mass_kg: float = 0.0


Array = np.ndarray
Markers = Sequence[Marker | tuple[float, ...]]
Loads = tuple[float, float, float, Array | None]  # (ramp, tip_on, share, history)


class _Points:
    """Material points; arguments are the unknowns (6, ..., points) of the points' elements."""

    def __init__(self, beam: Beam, x: ArrayLike, dx: ArrayLike, dz: ArrayLike) -> None:
        s = np.asarray(x, float) * beam.n_elements / beam.length_m
        self.element = np.clip(s.astype(int), 0, beam.n_elements - 1)
        self.n2 = s - self.element
        self.n1 = 1 - self.n2
        self.bubble = -beam.length_m / beam.n_elements / 2 * self.n1 * self.n2
        self.dx, self.dz = np.asarray(dx, float), np.asarray(dz, float)

    def place(self, q: Array) -> tuple[Array, Array, tuple[Array, ...], tuple[Array, ...]]:
        """Displacement (ux, uz), its derivatives by theta1 and theta2, and the vectors within."""
        x1, z1, t1, x2, z2, t2 = q
        th, tm, psi = self.n1 * t1 + self.n2 * t2, (t1 + t2) / 2, t2 - t1
        c, s = np.cos(th), np.sin(th)
        rx, rz = c * self.dx - s * self.dz, s * self.dx + c * self.dz
        bx, bz = -self.bubble * np.sin(tm), self.bubble * np.cos(tm)  # bubble * e3
        ux = self.n1 * x1 + self.n2 * x2 + rx - self.dx + psi * bx
        uz = self.n1 * z1 + self.n2 * z2 + rz - self.dz + psi * bz
        hx, hz = -psi * bz / 2, psi * bx / 2  # psi/2 d(bubble e3)/dtm = -psi/2 bubble e1
        j = (hx - self.n1 * rz - bx, hz + self.n1 * rx - bz, hx - self.n2 * rz + bx, hz + self.n2 * rx + bz)
        return ux, uz, j, (rx, rz, bx, bz, psi, c, s)

    def velocity(self, v: Array, j: tuple[Array, ...]) -> tuple[Array, Array]:
        x1, z1, w1, x2, z2, w2 = v
        return (self.n1 * x1 + self.n2 * x2 + j[0] * w1 + j[2] * w2, self.n1 * z1 + self.n2 * z2 + j[1] * w1 + j[3] * w2)

    def acceleration(self, v: Array, a: Array, j: tuple[Array, ...], vectors: tuple[Array, ...]) -> tuple[Array, Array]:
        rx, rz, bx, bz, psi = vectors[:5]
        w, wm, wp = self.n1 * v[2] + self.n2 * v[5], (v[2] + v[5]) / 2, v[5] - v[2]
        ax, az = self.velocity(a, j)
        ww, bend, turn = w * w, 2 * wp * wm, psi * wm * wm
        return ax - ww * rx - bend * bz - turn * bx, az - ww * rz + bend * bx - turn * bz


class Model:
    """The beam discretised in space; unknowns q = (ux, uz, theta) of each node."""

    def __init__(self, beam: Beam, markers: Markers = ()) -> None:
        self.beam, self.markers = beam, [m if isinstance(m, Marker) else Marker(*m) for m in markers]
        b, n = beam, beam.n_elements
        if any(not 0 <= m.x_m <= b.length_m for m in self.markers):
            raise ValueError("a marker's x_m must lie in [0, length_m]")
        self.l = b.length_m / n
        self.ndof = 3 * (n + 1)
        self.edof = 3 * np.arange(n) + np.arange(6)[:, None]
        zg, wg = np.polynomial.legendre.leggauss(b.n_fibres)
        self.z, self.w = b.height_m / 2 * zg, b.width_m * b.height_m / 2 * wg
        area, inertia = b.width_m * b.height_m, b.width_m * b.height_m**3 / 12
        self.shear = 1 / (1 / (5 / 6 * 2 * b.c10_pa * area) + self.l**2 / (12 * 6 * b.c10_pa * inertia))
        self.rotary = b.density_kg_per_m3 * inertia * self.l / 2  # at each element end
        # points: two Gauss points an element, the tip point, the markers
        g = np.array([0.5 - 0.5 / 3**0.5, 0.5 + 0.5 / 3**0.5])
        ng, more = 2 * n, self.markers
        self.tip, none = ng, np.zeros(ng)
        self.pts = _Points(
            b,
            np.r_[((np.arange(n)[:, None] + g) * self.l).ravel(), b.length_m, [m.x_m for m in more]],
            np.r_[none, 0, [m.standoff_x_m for m in more]],
            np.r_[none, b.tip_offset_z_m, [m.z_m + m.standoff_z_m for m in more]],
        )
        own_length = np.r_[none + 0.5 * self.l, 0, [0 for m in more]]  # length of beam at each
        added = np.r_[none, b.tip_mass_kg, [m.mass_kg for m in more]]
        heavy = np.r_[none, b.tip_mass_has_weight, [b.marker_masses_have_weight for m in more]]
        own = b.density_kg_per_m3 * area * own_length
        self.mass, self.mass_damping, self.weight = own + added, b.alpha_per_s * own, own + heavy * added
        self.drag_area = b.width_m * own_length
        compliance = np.r_[b.clamp_axial_m_per_n, b.clamp_transverse_m_per_n, b.clamp_rotational_rad_per_nm]
        self.spring = np.divide(1, compliance, out=np.zeros(3), where=compliance > 0)
        self.free = np.r_[np.flatnonzero(compliance > 0), 3 : self.ndof]
        self.scale = np.tile([1 / b.length_m, 1 / b.length_m, 1.0], n + 1)[self.free]
        both = np.c_[self.edof, self.edof[:, self.pts.element]]
        self.rows, self.flat = both.ravel(), (both[:, None] * self.ndof + both).ravel()

    def strains(self, qe: Array) -> tuple[Array, ...]:
        """1 + eps, gamma, kappa of the elements; cosine, sine, and arc over chord and length."""
        x1, z1, t1, x2, z2, t2 = qe
        tm, psi = (t1 + t2) / 2, t2 - t1
        c, s, arc = np.cos(tm), np.sin(tm), (1 + psi * psi / 24) / self.l
        rx, rz = (self.l + x2 - x1) * arc, (z2 - z1) * arc
        return c * rx + s * rz, c * rz - s * rx, psi / self.l, c, s, arc

    def stress(self, stretch: Array) -> Array:
        square = stretch * stretch
        i1 = square + 2 / stretch - 3
        return 2 * (stretch - 1 / square) * (self.beam.c10_pa + 2 * self.beam.c20_pa * i1)

    def stiffness(self, stretch: Array) -> Array:
        inv2 = 1 / (stretch * stretch)
        f, i1 = stretch - inv2, stretch * stretch + 2 * stretch * inv2 - 3
        return 2 * (1 + 2 * inv2 / stretch) * (self.beam.c10_pa + 2 * self.beam.c20_pa * i1) + 8 * self.beam.c20_pa * f * f

    def elastic(self, q: Array) -> Array:
        """Elastic fibre stresses and shear forces (elements, fibres + 1): the Prony history."""
        a, gamma, kappa = self.strains(q[self.edof])[:3]
        return np.c_[self.stress(a[:, None] - kappa[:, None] * self.z), self.shear * gamma]

    def internal(self, qe: Array, ve: Array, ae: Array, share: float, history: Array | None) -> Array:
        """Element forces from stress = share * elastic + history + beta * d(elastic)/dt; rotary inertia."""
        b = self.beam
        a, gamma, kappa, c, s, arc = self.strains(qe)
        stretch = a[..., None] - kappa[..., None] * self.z
        p, v = share * self.stress(stretch), share * self.shear * gamma
        if history is not None:
            p, v = p + history[:, :-1], v + history[:, -1]
        grow = self.l * kappa / (12 * arc)  # d(ln arc)/dkappa
        if b.beta_s:
            dx, dz, dk = (ve[3] - ve[0]) * arc, (ve[4] - ve[1]) * arc, (ve[5] - ve[2]) / self.l
            om = (ve[2] + ve[5]) / 2
            da = c * dx + s * dz + om * gamma + grow * dk * a
            p = p + b.beta_s * self.stiffness(stretch) * (da[..., None] - dk[..., None] * self.z)
            v = v + b.beta_s * self.shear * (c * dz - s * dx - om * a + grow * dk * gamma)
        n = p @ self.w
        m = grow * (n * a + v * gamma) - p @ (self.w * self.z)
        la = self.l * arc
        fx, fz, ft = la * (n * c - v * s), la * (n * s + v * c), self.l / 2 * (n * gamma - v * a)
        turn = self.rotary * (ae + b.alpha_per_s * ve)
        return np.array([-fx, -fz, ft - m + turn[2], fx, fz, ft + m + turn[5]])

    def external(self, q: Array, v: Array, a: Array, ramp: float, tip_on: float) -> Array:
        """Inertia, damping and drag less the loads of all points, on their elements' unknowns."""
        b, pts = self.beam, self.pts
        _, _, j, vectors = pts.place(q)
        vx, vz = pts.velocity(v, j)
        ax, az = pts.acceleration(v, a, j, vectors)
        fx = self.mass * ax + self.mass_damping * vx - ramp * b.gravity_x_m_per_s2 * self.weight
        fz = self.mass * az + self.mass_damping * vz - ramp * b.gravity_z_m_per_s2 * self.weight
        c, s = vectors[5:]
        quadratic = 0.5 * b.air_density_kg_per_m3 * b.drag_coefficient
        if b.drag_linear_ns_per_m3 or quadratic:
            vn = c * vz - s * vx
            d = self.drag_area * vn * (b.drag_linear_ns_per_m3 + quadratic * vn * np.sign(vn.real))
            fx, fz = fx - s * d, fz + c * d
        t, load = self.tip, ramp * tip_on
        ct, st = (c[..., t], s[..., t]) if b.tip_force_follower else (1.0, 0.0)
        fx[..., t] -= load * (ct * b.tip_force_x_n - st * b.tip_force_z_n)
        fz[..., t] -= load * (st * b.tip_force_x_n + ct * b.tip_force_z_n)
        return np.array([pts.n1 * fx, pts.n1 * fz, j[0] * fx + j[1] * fz, pts.n2 * fx, pts.n2 * fz, j[2] * fx + j[3] * fz])

    def forces(self, qe: Array, ve: Array, ae: Array, loads: Loads) -> Array:
        ramp, tip_on, share, history = loads
        e = self.pts.element
        return np.concatenate(
            [self.internal(qe, ve, ae, share, history), self.external(qe[..., e], ve[..., e], ae[..., e], ramp, tip_on)], -1
        )

    def residual(self, q: Array, v: Array, a: Array, loads: Loads) -> Array:
        """Out-of-balance force at the free unknowns; loads = (ramp, tip_on, share, history)."""
        f = self.forces(q[self.edof], v[self.edof], a[self.edof], loads)
        r = np.bincount(self.rows, f.ravel(), self.ndof)
        r[:3] += self.spring * q[:3]
        return r[self.free]

    def tangent(self, q: Array, v: Array, a: Array, c: tuple[float, float, float], loads: Loads) -> Array:
        """d residual / dy with dq, dv, da = (c0, c1, c2) dy: exact, by complex steps."""
        step = 1e-30j * np.eye(6)[:, :, None]
        qe, ve, ae = (x[self.edof][:, None] + cx * step for x, cx in zip((q, v, a), c, strict=True))
        f = self.forces(qe, ve, ae, loads)
        k: Array = np.bincount(self.flat, f.imag.ravel() / 1e-30, self.ndof**2).reshape(self.ndof, self.ndof)
        k[range(3), range(3)] += c[0] * self.spring
        return k[np.ix_(self.free, self.free)]

    def energy(self, q: Array, v: Array) -> tuple[float, float, float]:
        """(kinetic, elastic, potential of weight and of a dead tip force), at full loads."""
        b, qe, ve, e = self.beam, q[self.edof], v[self.edof], self.pts.element
        a, gamma, kappa = self.strains(qe)[:3]
        stretch = a[:, None] - kappa[:, None] * self.z
        i1 = stretch**2 + 2 / stretch - 3
        elastic = self.l * np.sum((b.c10_pa * i1 + b.c20_pa * i1**2) @ self.w + self.shear * gamma**2 / 2)
        elastic += np.sum(self.spring * q[:3] ** 2) / 2
        ux, uz, j, _ = self.pts.place(qe[:, e])
        vx, vz = self.pts.velocity(ve[:, e], j)
        kinetic = (self.mass @ (vx**2 + vz**2) + self.rotary * np.sum(ve[[2, 5]] ** 2)) / 2
        weight = self.weight @ (b.gravity_x_m_per_s2 * ux + b.gravity_z_m_per_s2 * uz)
        tip = b.tip_force_x_n * ux[self.tip] + b.tip_force_z_n * uz[self.tip]
        return kinetic, elastic, -weight - tip

    def displacements(self, q: Array) -> Array:
        """(..., unknowns) -> (..., markers, 2)"""
        qe = np.moveaxis(q[..., self.edof[:, self.pts.element]], -2, 0)
        return np.stack(self.pts.place(qe)[:2], -1)[..., self.tip + 1 :, :]

    def equilibrium(self, long_term: bool = True) -> Array:
        """Static q under the full loads; long_term: all of prony_g has relaxed."""
        share = 1 - self.beam.prony_g if long_term else 1.0
        done, step, q, zero = 0.0, 0.1, np.zeros(self.ndof), np.zeros(self.ndof)
        while done < 1:
            trial, loads = q.copy(), (min(1.0, done + step), 1.0, share, None)
            for _ in range(30):
                k = self.tangent(trial, zero, zero, (1, 0, 0), loads)
                dq = np.linalg.solve(k, -self.residual(trial, zero, zero, loads))
                trial[self.free] += dq
                size = np.max(np.abs(dq * self.scale))
                if not 1e-10 < size < 1:
                    break
            if size <= 1e-10:
                q, done, step = trial, loads[0], step * 1.5
            elif (step := step / 2) < 1e-5:
                raise RuntimeError("no static convergence")
        return q

    def integrate(self, end_s: float) -> tuple[Array, Array, Array]:
        """Times (k,), q (k, unknowns), velocities (k, unknowns) at all steps from 0 to end_s."""
        b, free = self.beam, self.free
        am, af = (2 * b.rho_inf - 1) / (b.rho_inf + 1), b.rho_inf / (b.rho_inf + 1)
        gam, bet = 0.5 + af - am, (1 + af - am) ** 2 / 4
        q, v = np.zeros(self.ndof), np.zeros(self.ndof)
        s_old = q_old = np.zeros((b.n_elements, b.n_fibres + 1))
        inside = [t for t in (b.load_start_s, b.release_s) if 0 < t < end_s]
        stops = np.unique([0.0, *inside, end_s])  # steps end where a load jumps or bends
        times, qs, vs = [0.0], [q], [v]
        for start, end in pairwise(stops):
            count = int(np.ceil((end - start) / b.dt_s - 1e-9))
            dt, tip_on = (end - start) / count, float(start >= b.load_start_s)
            ramp = (lambda t: min(1.0, t / b.release_s)) if b.release_s else (lambda t: 1.0)
            decay = np.exp(-dt / b.prony_tau_s)
            gain = b.prony_g * (1 - decay) * b.prony_tau_s / dt
            # acceleration in equilibrium with the loads just after `start`
            acc, inverse = np.zeros(self.ndof), None
            loads: Loads = (ramp(start), tip_on, 1 - b.prony_g, q_old)
            mass = self.tangent(q, v, acc, (0, 0, 1), loads)
            acc[free] = -np.linalg.solve(mass, self.residual(q, v, acc, loads))
            alg = acc  # the algorithmic acceleration of the method
            c = (1.0, gam / (bet * dt), (1 - am) / ((1 - af) * bet * dt**2))
            for t in start + dt * np.arange(1, count + 1):
                history = decay * q_old - gain * s_old if b.prony_g else None
                loads = (ramp(t), tip_on, 1 - b.prony_g + gain, history)
                # first guess: alg unchanged
                new = (q + dt * v + dt**2 / 2 * alg, v + dt * alg, (alg - af * acc) / (1 - af))
                last = np.inf
                for _ in range(60):
                    if inverse is None:
                        inverse, last = np.linalg.inv(self.tangent(*new, c, loads)), np.inf
                    dq = -inverse @ self.residual(*new, loads)
                    for x, factor in zip(new, c, strict=True):
                        x[free] += factor * dq
                    size = np.max(np.abs(dq * self.scale))
                    if size < 1e-10 or size * size < 1e-11 * last < np.inf:  # next one < 1e-11
                        break
                    if not size < 0.2 * last:  # the kept tangent is too old
                        inverse = None
                    last = size
                else:
                    raise RuntimeError(f"no convergence at t = {t:.6f} s: use a smaller dt_s")
                alg = ((1 - af) * new[2] + af * acc - am * alg) / (1 - am)
                q, v, acc = new
                if b.prony_g:
                    s_new = self.elastic(q)
                    q_old, s_old = decay * q_old + gain * (s_new - s_old), s_new
                times.append(t)
                qs.append(q)
                vs.append(v)
        return np.array(times), np.array(qs), np.array(vs)


def simulate(beam: Beam, markers: Markers, times_s: ArrayLike) -> Array:
    """Displacements (dx, dz) in metres of the markers at the times: array (len(times_s), markers, 2).

    Markers are `Marker`s or tuples (x, z[, standoff_x, standoff_z[, mass]]).  Straight and at rest at 0.
    """
    wanted = np.atleast_1d(np.asarray(times_s, float))
    if wanted.size == 0 or not np.all((wanted >= 0) & np.isfinite(wanted)):
        raise ValueError("times_s must be finite, not negative and not empty")
    model = Model(beam, markers)
    t, q, v = model.integrate(max(wanted.max(), beam.dt_s))
    return model.displacements(CubicHermiteSpline(t, q, v)(wanted))


def static(beam: Beam, markers: Markers, long_term: bool = True) -> Array:
    """Static displacements (markers, 2) under all loads; long_term: after all relaxation."""
    model = Model(beam, markers)
    return model.displacements(model.equilibrium(long_term))
