"""Cost of a step with a one-term Ogden law in hex8, relative to Yeoh: the reason why elements do not offer the Ogden law.

    python studies/benchmarks/ogden_step.py

The energy of the Ogden law is a function of the isochoric stretches. Its derivatives with respect to I1_bar and I2_bar follow
from the roots x of x^3 - I1_bar x^2 + I2_bar x - 1 = 0, the squared isochoric stretches. With
w(x) = 2 mu / alpha^2 (x^(alpha/2) - 1):

    dW/dI1_bar = sum of x_i^2 w'(x_i) / prod (x_i - x_j),  dW/dI2_bar = - sum of x_i w'(x_i) / prod (x_i - x_j).

Where roots are nearly equal, smooth weights replace the quotients by derivatives. Measured with 8 lanes, 30 000 elements and one
thread on a loaded machine, best of 6 alternating runs: Yeoh 133 ns, Ogden with one term 330 ns, ratio 2.49. Elements offer laws
that cost at most twice a Yeoh step. Without the treatment of equal roots the ratio is 1.69, but the law is then not usable.

The program first compares the stress with that of ``materials/homogeneous.py``.
"""

from __future__ import annotations

import sys
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from explicitfe.app.tools.speed import TIMED_SIZES, block, nanoseconds
from explicitfe.fem.materials import LAWS
from explicitfe.fem.materials.homogeneous import nominal_stress
from explicitfe.fem.materials.law import Law
from explicitfe.fem.materials.ogden import Ogden
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.model.model import Model
from explicitfe.fem.solve import point
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.simd import exp, log, maximum, minimum, square_root

ELEMENTS = 30_000
MU_PA, ALPHA = 383.0, 4.0
TINY = 1e-30
NEAR = 1e-10  # square of the distance of roots below which derivatives replace quotients
REPEATS = 6


class OneTerm(Law):
    """One Ogden term as a function of both invariants."""

    invariants: ClassVar[tuple[str, ...]] = ("I1", "I2")
    reads: ClassVar[tuple[str, ...]] = ("mu_Pa", "alpha")

    law: Literal["ogden-timed"] = "ogden-timed"
    mu_Pa: float = Field(gt=0.0)
    alpha: float

    @property
    def shear_modulus_Pa(self) -> float:
        return self.mu_Pa


@leaf
def roots(I1_bar, I2_bar):
    """Squared isochoric stretches, the one farthest from the mean first, by Cardano's formula with Newton's cube root."""
    mean = I1_bar * (1.0 / 3.0)
    r = square_root(maximum(mean * mean - I2_bar * (1.0 / 3.0), 0.0 * I1_bar) + TINY)
    t = mean * mean * mean - 0.5 * mean * I2_bar + 0.5
    t = maximum(minimum(t / (r * r * r), 0.0 * t + 1.0), 0.0 * t - 1.0)
    size = square_root(t * t + TINY)
    c = 0.866 + 0.134 * size
    c = c - (4.0 * c * c * c - 3.0 * c - size) / (12.0 * c * c - 3.0)
    c = c - (4.0 * c * c * c - 3.0 * c - size) / (12.0 * c * c - 3.0)
    far = 2.0 * r * c * t / size
    half = 1.7320508075688772 * r * square_root(maximum(1.0 - c * c, 0.0 * c) + TINY)
    return mean + far, mean - 0.5 * far + half, mean - 0.5 * far - half


@leaf
def isochoric(I1_bar, I2_bar, c):
    """W without U [Pa]; c = (mu, alpha, K)."""
    x, y, z = roots(I1_bar, I2_bar)
    half = 0.5 * c[1]
    return 2.0 * c[0] / (c[1] * c[1]) * (exp(half * log(x)) + exp(half * log(y)) + exp(half * log(z)) - 3.0)


@leaf
def divided(fa, fb, fc, da, db, dc, a, b, c):
    """Second divided difference of f at a, b, c, where a is the root farthest from the others; f and f' are given.

    Where two roots, or all three, are nearer than about ``NEAR``, the quotient turns smoothly into the derivative.
    """
    gap = b - c
    weight = gap * gap + NEAR
    near = ((fb - fc) * gap + 0.5 * NEAR * (db + dc)) / weight
    span = a - c
    far = ((fa - fb) * (a - b) + 0.5 * NEAR * (da + db)) / ((a - b) * (a - b) + NEAR)
    return (far - near) * span / (span * span + NEAR)


@leaf
def slopes(I1_bar, I2_bar, c):
    """dW/dI1_bar and dW/dI2_bar [Pa]."""
    x, y, z = roots(I1_bar, I2_bar)
    half = 0.5 * c[1]
    p, q, s = exp(half * log(x)), exp(half * log(y)), exp(half * log(z))  # f(x) = x^half; x f is that of dW/dI1_bar
    factor = c[0] / c[1]
    more = half + 1.0
    first = divided(p * x, q * y, s * z, more * p, more * q, more * s, x, y, z)
    second = divided(p, q, s, half * p / x, half * q / y, half * s / z, x, y, z)
    # At the reference state all roots are 1 and the second divided difference is half the second derivative.
    blend = NEAR / ((x - z) * (x - z) + NEAR)
    first = first + blend * 0.5 * half * more
    second = second + blend * 0.5 * half * (half - 1.0)
    return factor * first, -factor * second


def body(law: Law) -> Simulation:
    """A block of distorted hexahedra, as ``explicitfe bench`` times it."""
    mesh = block(TIMED_SIZES[ELEMENTS])
    free = np.zeros((mesh.node_count, 3), dtype=bool)
    velocity = np.random.default_rng(1).standard_normal((mesh.node_count, 3)) * 1e-3
    return Simulation(Model(mesh, law, free, alpha_per_s=40.0), velocity=velocity, threads=1)


def main() -> None:
    LAWS["ogden-timed"] = (OneTerm, sys.modules[__name__])
    timed, reference = OneTerm(mu_Pa=MU_PA, alpha=ALPHA), Ogden(mu1_Pa=MU_PA, alpha1=ALPHA)
    stretch, gamma, times = np.array([0.5, 0.9, 0.999, 1.001, 1.3, 2.0]), np.array([1e-4, 1e-2, 0.1, 0.5, 1.0]), np.zeros(6)
    for mode, compute, imposed in (
        ("uniaxial", point.uniaxial, stretch),
        ("biaxial", point.biaxial, stretch),
        ("shear", point.shear, gamma),
    ):
        off = compute(timed, (), times[: len(imposed)], imposed) - nominal_stress(reference, mode, imposed)
        print(f"{mode}: largest difference of the stress from the closed form {np.abs(off).max() / MU_PA:.1e} of mu")
    bodies = {"Yeoh": body(Yeoh(C10_Pa=0.5 * MU_PA, C20_Pa=90.6)), "Ogden, one term": body(timed)}
    best = dict.fromkeys(bodies, np.inf)
    for _ in range(REPEATS):
        for name, simulation in bodies.items():
            best[name] = min(best[name], nanoseconds(simulation))
    for name, ns in best.items():
        print(f"{name:<16} {ns:6.1f} ns per element and step")
    print(f"ratio            {best['Ogden, one term'] / best['Yeoh']:6.2f}")


if __name__ == "__main__":
    main()
