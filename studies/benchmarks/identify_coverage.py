"""How often the 95 % interval of the shear modulus contains the truth, also for laws that do not describe the material.

    python studies/benchmarks/identify_coverage.py [SEEDS]

Homogeneous tests of Ogden materials with 25 kPa shear modulus and 0.5 % noise, 80 rows, fitted with the laws of ``LAWS``.
"""

from __future__ import annotations

import sys

import numpy as np

from explicitfe.fem.materials.homogeneous import nominal_stress
from explicitfe.fem.materials.ogden import Ogden
from explicitfe.inverse.identify.compare_laws import (
    LawFit,
    compared,
    fit_stable,
    model_form_factor,
    range_test,
    stretches_in_data,
)
from explicitfe.inverse.identify.forward import CurveModel, PointResponse
from explicitfe.inverse.identify.laws import FIT_LAWS
from explicitfe.inverse.identify.observed import Observed

MU_PA, POISSON, NOISE_SHARE, ROWS = 25e3, 0.499, 0.005, 80
ALPHAS = (4.0, 1.2, 8.0)
LARGEST_STRETCHES = (1.6, 0.6, 1.25)
LAWS = ("yeoh", "neo-hooke", "mooney-rivlin", "yeoh-3", "ogden-1", "ogden-2")


def contains(stretch: np.ndarray, stress_Pa: np.ndarray) -> list[bool]:
    """For each law whether its interval of the shear modulus contains the truth."""
    fits = []
    for name in LAWS:
        law = FIT_LAWS[name]
        observed = [Observed("made", stretch, stress_Pa, None, None, CurveModel(PointResponse("uniaxial", POISSON, law)))]
        fits.append(LawFit(law, observed, fit_stable(observed, law, POISSON, stretches_in_data(observed))[0]))
    fits = compared(fits)
    hits = []
    for row in fits:
        assert row.fit is not None
        modulus, sd = row.fit.shear_modulus
        factor = model_form_factor(row.fit, fits, range_test(row.observed, row.fit))
        hits.append(abs(modulus - MU_PA) <= row.fit.quantile * row.fit.widening.of_residual * factor * sd)
    return hits


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 6
    print(f"| alpha | stretch | {' | '.join(LAWS)} | of |\n|---|---|{'---|' * (len(LAWS) + 1)}")
    for alpha in ALPHAS:
        for largest in LARGEST_STRETCHES:
            stretch = np.linspace(1.0, largest, ROWS)
            stress = nominal_stress(Ogden(mu1_Pa=MU_PA, alpha1=alpha, poisson=POISSON), "uniaxial", stretch)
            noise = NOISE_SHARE * np.abs(stress).max()
            hits = [
                contains(stretch, stress + noise * np.random.default_rng(seed).standard_normal(ROWS)) for seed in range(seeds)
            ]
            print(f"| {alpha:g} | {largest:g} | {' | '.join(map(str, np.sum(hits, axis=0)))} | {seeds} |", flush=True)


if __name__ == "__main__":
    main()
