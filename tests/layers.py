"""Linear elastic layers bonded to a rigid base and pressed by a frictionless rigid punch: reference solutions.

Layer of thickness h, moduli E, G = E / (2 (1 + nu)), Poisson's ratio nu; small strains, no friction under the punch, no traction
beside it, no displacement at the base, no edge (infinite extent). Lengths m, forces N, moduli Pa; ratios carry no unit.

Derivation. A surface pressure p(r) = integral of k p^(k) J0(k r) dk sinks the surface by

    u(r) = (1 - nu) / G integral of N(k h) p^(k) J0(k r) dk                                    N: ``layer_compliance``

p^(k) = integral over 0 < t < a of phi(t) cos(k t) dt leaves r > a without pressure, and u = w(r) for r < a becomes, after d/dx of
the integral of r (.) / sqrt(x^2 - r^2) dr from 0 to x, a Fredholm equation of the second kind (Lebedev & Ufliand 1958, Prikl.
Mat. Mekh. 22:442; Hayes, Keer, Herrmann & Mockros 1972, J. Biomech. 5:541). With x, y in units of a and q = a / h,

    f(x) - (2 / pi) integral over 0 < y < 1 of K(x, y) f(y) dy = g(x)
    K(x, y) = q integral over s > 0 of (1 - N(s)) cos(s q x) cos(s q y) ds

g = 1 for a flat punch, w = 1; g = x^2 for w = x^2 / 2. Force: 2 E a / (1 - nu^2) x integral of f. Nothing here is taken from the
tables of these papers, only the equation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.special import roots_legendre

LARGEST_WAVENUMBER = 20.0  # 1 / h: there 1 - N is at most 7e-15
POINTS = 32  # kappa at a / h = 1 changes by less than 1e-12 from 20 points on


# ---- the layer ----


def layer_deficit(s: np.ndarray, poisson: float) -> np.ndarray:
    """1 - N(s), written without the cancellation at large s = k h."""
    c = 3.0 - 4.0 * poisson
    d = 5.0 - 12.0 * poisson + 8.0 * poisson**2
    return (c * np.exp(-2.0 * s) + 2.0 * s + 2.0 * s**2 + d) / (c * np.cosh(2.0 * s) + 2.0 * s**2 + d)


def layer_compliance(s: np.ndarray, poisson: float) -> np.ndarray:
    """N(s), by which a bonded layer sinks relative to a half space under a pressure of wavenumber k = s / h.

    N = [(3 - 4 nu) sinh 2s - 2s] / [(3 - 4 nu) cosh 2s + 2 s^2 + 5 - 12 nu + 8 nu^2], so that u^ = (1 - nu) p^ N / (G k). Tested
    against ``layer_compliance_solved``. N -> 1 for s -> infinity; for s -> 0, s (1 - 2 nu) / (2 (1 - nu)^2), the oedometric
    modulus, and 2 s^3 / 3 for nu = 1/2, the flow of a thin incompressible film.
    """
    return 1.0 - layer_deficit(s, poisson)


def layer_compliance_solved(s: float, poisson: float) -> float:
    """N(s) from the equations of elasticity themselves, with G = h = 1; for s < 8, as growing and decaying parts mix.

    With u_r = U J1(s r), u_z = W J0, tau_rz = T J1, sigma_zz = S J0, M = 2 (1 - nu) / (1 - 2 nu) and lambda / M = nu / (1 - nu),
    Hooke's law and equilibrium are four ordinary differential equations in z that stay finite at nu = 1/2:

        U' = s W + T                       W' = -s nu / (1 - nu) U + S / M
        T' = 2 s^2 / (1 - nu) U + s nu / (1 - nu) S            S' = -s T

    U = W = 0 at the base, T = 0, S = 1 at the surface.
    """
    b = poisson / (1.0 - poisson)
    system = np.zeros((4, 4))  # U, W, T, S
    system[0, [1, 2]] = s, 1.0
    system[1, [0, 3]] = -s * b, (1.0 - 2.0 * poisson) / (2.0 * (1.0 - poisson))
    system[2, [0, 3]] = 2.0 * s**2 / (1.0 - poisson), s * b
    system[3, 2] = -s
    across = expm(system)
    base = np.linalg.solve(across[2:, 2:], [0.0, 1.0])
    return float(across[1, 2:] @ base) * s / (1.0 - poisson)


# ---- punches on the layer ----


class Densities(NamedTuple):
    """f for the right-hand sides 1 and x^2 at the Gauss points of 0 < x < 1, and at the edge x = 1."""

    x: np.ndarray  # (n,)
    weights: np.ndarray  # (n,)
    f: np.ndarray  # (n, 2)
    edge: np.ndarray  # (2,)


def gauss(count: int, to: float) -> tuple[np.ndarray, np.ndarray]:
    """Points and weights of Gauss-Legendre quadrature between 0 and ``to``."""
    x, weights = roots_legendre(count)
    return 0.5 * to * (x + 1.0), 0.5 * to * weights


def wavenumbers(radius_over_thickness: float, points: int = POINTS) -> tuple[np.ndarray, np.ndarray]:
    """Points and weights over s, enough for cos(s q x) cos(s q y)."""
    return gauss(2 * points + int(np.ceil(32.0 * radius_over_thickness)), LARGEST_WAVENUMBER)


def punch_densities(radius_over_thickness: float, poisson: float, points: int = POINTS) -> Densities:
    """Solve the Fredholm equation of the module by Nystrom's method; 0 <= nu <= 1/2, a / h >= 0.

    ``points`` along the radius, and five more for each unit of a / h. The kernel is analytic: convergence is exponential.
    """
    q = radius_over_thickness
    x, weights = gauss(points + int(np.ceil(5.0 * q)), 1.0)
    s, of_s = wavenumbers(q, points)
    waves = np.cos(q * np.outer(np.append(x, 1.0), s))
    kernel = 2.0 / np.pi * q * (waves * (of_s * layer_deficit(s, poisson))) @ waves[:-1].T * weights
    given = np.stack([np.ones_like(x), x**2], axis=1)
    f = np.linalg.solve(np.eye(x.size) - kernel[:-1], given)
    return Densities(x, weights, f, 1.0 + kernel[-1] @ f)


def hayes_factor(radius_over_thickness: float, poisson: float, points: int = POINTS) -> float:
    """kappa of a rigid flat circular punch of radius a: P = 2 E a / (1 - nu^2) kappa delta = 4 G a / (1 - nu) kappa delta.

    Hayes et al. (1972); to 1e-10 up to a / h = 5 and 1e-6 up to 40, where the layer of nu = 1/2 is ill conditioned. kappa -> 1
    for a / h -> 0 (Boussinesq); for a / h -> infinity it grows by (pi / 2) (1 - nu)^2 / (1 - 2 nu) for each unit of a / h
    (oedometer), for nu = 1/2 as 3 pi / 64 (a / h)^3 (squeezed film).

    Do not use the table printed in 1972 as an exact value: for nu = 1/2 it lies 0.04, 0.27, 0.9 and 6 % below at a / h = 0.4, 1,
    2 and 8, and from 0.8 on below the bounds of ``hayes_bound``, which no stiffness can be.
    """
    solved = punch_densities(radius_over_thickness, poisson, points)
    return float(solved.weights @ solved.f[:, 0])


def hayes_bound(radius_over_thickness: float, poisson: float, functions: int) -> float:
    """A rigorous lower bound of kappa, rising to it with the number of functions; needs no integral equation.

    Of all pressures p under the punch the true one minimises 1/2 (p, u[p]) - (p, w) (Ritz). With f = sum of c_j x^(2 j), by
    Parseval's theorem kappa >= b A^-1 b, b_j = 1 / (2 j + 1), A_ij = 1 / (2 i + 2 j + 1) - (2 / pi) q integral of
    (1 - N) F_i F_j ds, F_j(s) = integral over 0 < x < 1 of x^(2 j) cos(s q x) dx.
    """
    q = radius_over_thickness
    s, of_s = wavenumbers(q)
    x, of_x = gauss(POINTS + int(np.ceil(LARGEST_WAVENUMBER * q)), 1.0)
    powers = x ** (2 * np.arange(functions)[:, None])
    F = (powers * of_x) @ np.cos(q * np.outer(x, s))
    A = (powers * of_x) @ powers.T - 2.0 / np.pi * q * (F * of_s * layer_deficit(s, poisson)) @ F.T
    b = powers @ of_x
    return float(b @ np.linalg.solve(A, b))


def flat_punch_force(E: float, a: float, delta: float, h: float, poisson: float) -> float:
    """Force N on a rigid flat punch of radius a that sinks by delta (see ``hayes_factor``)."""
    return 2.0 * E * a / (1.0 - poisson**2) * hayes_factor(a / h, poisson) * delta


def sphere_layer_contact(E: float, R: float, a: float, h: float, poisson: float, points: int = POINTS) -> tuple[float, float]:
    """Depth m and force N at which a rigid paraboloid r^2 / (2 R) touches within the radius a.

    f = delta f_1 - a^2 / R f_2, which vanishes at the edge: the pressure ends there without a singularity. So delta =
    a^2 / R f_2(1) / f_1(1). For a / h -> 0, Hertz: delta = a^2 / R, P = 4 E a^3 / (3 (1 - nu^2) R). A sphere is taken for a
    paraboloid, as by Hertz and Dimitriadis: a << R.
    """
    solved = punch_densities(a / h, poisson, points)
    depth = a**2 / R * solved.edge[1] / solved.edge[0]
    of_one, of_square = solved.weights @ solved.f
    return float(depth), float(2.0 * E * a / (1.0 - poisson**2) * (depth * of_one - a**2 / R * of_square))


def sphere_layer_force(E: float, R: float, delta: float, h: float, poisson: float, points: int = POINTS) -> float:
    """Force N on a rigid sphere (paraboloid) of radius R that sinks by delta, from the integral equation; 0 <= nu <= 1/2.

    chi = sqrt(R delta) / h up to 10. The contact radius lies between sqrt(R delta) (half space) and twice that (squeezed film).
    """
    touched = np.sqrt(R * delta)

    def excess(a: float) -> float:
        return sphere_layer_contact(E, R, a, h, poisson, points)[0] / delta - 1.0

    a = brentq(excess, 0.99 * touched, 2.5 * touched, xtol=1e-13 * touched)
    return sphere_layer_contact(E, R, a, h, poisson, points)[1]


# ---- closed forms ----


def hertz_force(E: float, R: float, delta: float, poisson: float) -> float:
    """Force N on a rigid sphere in a half space (Hertz 1881): 4 E / (3 (1 - nu^2)) sqrt(R) delta^1.5."""
    return 4.0 * E / (3.0 * (1.0 - poisson**2)) * np.sqrt(R) * delta**1.5


# F / Hertz in powers of chi = sqrt(R delta) / h, for nu = 1/2, as printed in Dimitriadis et al. (2002).
DIMITRIADIS = np.array([1.0, 1.133, 1.283, 0.769, 0.0975])


def dimitriadis_coefficients(poisson: float) -> np.ndarray:
    """F / Hertz in powers of chi = sqrt(R delta) / h for a bonded layer, any nu (Dimitriadis et al. 2002, Biophys. J. 82:2798).

    At nu = 1/2 the last one is -0.0975, where their equation for nu = 1/2 prints +0.0975; the others agree. As to second order an
    exact expansion has 7/6 of the coefficient of chi^2 (``sphere_series``), both fall short of the integral equation.
    """
    alpha = -(1.2876 - 1.4678 * poisson + 1.3442 * poisson**2) / (1.0 - poisson)
    beta = (0.6387 - 1.0277 * poisson + 1.5164 * poisson**2) / (1.0 - poisson)
    return np.array(
        [
            1.0,
            -2.0 / np.pi * alpha,
            4.0 / np.pi**2 * alpha**2,
            -8.0 / np.pi**3 * (alpha**3 + 4.0 * np.pi**2 / 15.0 * beta),
            16.0 * alpha / np.pi**4 * (alpha**3 + 3.0 * np.pi**2 / 5.0 * beta),
        ]
    )


def dimitriadis_force(E: float, R: float, delta: float, h: float) -> float:
    """Force N on a rigid sphere in a bonded layer, nu = 1/2: 16/9 E sqrt(R) delta^1.5 (1 + 1.133 chi + ... + 0.0975 chi^4).

    Dimitriadis et al. (2002). Against the integral equation 1 % too small at chi = 0.2, 8 % at 0.5, 16 % at 1: no reference for a
    solver, see ``sphere_layer_force``.
    """
    return float(hertz_force(E, R, delta, 0.5) * np.polynomial.polynomial.polyval(np.sqrt(R * delta) / h, DIMITRIADIS))


def dimitriadis_force_general(E: float, R: float, delta: float, h: float, poisson: float) -> float:
    """The same for any nu, with ``dimitriadis_coefficients``."""
    chi = np.sqrt(R * delta) / h
    return float(hertz_force(E, R, delta, poisson) * np.polynomial.polynomial.polyval(chi, dimitriadis_coefficients(poisson)))


def sphere_series(poisson: float) -> np.ndarray:
    """F / Hertz = 1 + A chi + 7/6 A^2 chi^2 + O(chi^3), A = (2 / pi) integral of (1 - N(s)) ds, exactly.

    For q = a / h -> 0 the kernel is the constant pi A q / 2 up to q^3. Then f_1 = 1 / (1 - A q), f_2 = x^2 + A q / (3 (1 - A q)),
    hence R delta / a^2 = 1 - 2 A q / 3 and P = 4 E a^3 / (3 (1 - nu^2) R): F / Hertz = (1 - 2 A q / 3)^-1.5.
    """
    s, weights = wavenumbers(0.0)
    A = 2.0 / np.pi * float(weights @ layer_deficit(s, poisson))
    return np.array([1.0, A, 7.0 / 6.0 * A**2])
