"""Sizes in the tests of specimens, of which the ranges of effects' parameters are multiples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from explicitfe.fem.effects import EFFECTS
from explicitfe.inverse.close_loop.statistics.system import Scales
from explicitfe.inverse.measured.curve import Curve, programme_of

# Under a tool the strain is about the depth over the tool's radius, and no larger than this.
LARGEST_STRAIN_UNDER_A_TOOL = 0.6
# An edge may be rounder by about the stated rounding, and by no less than the first of these shares of the tool's radius; by the
# second one where it is called sharp, which it is where nobody measured it.
KNOWN_EDGE_SHARE, SHARP_EDGE_SHARE = 0.1, 0.3


def scales_of(curves: Sequence[Curve], C10: float, C20: float) -> Scales:
    """Sizes in the tests of some curves.

    Parameters
    ----------
    C10, C20 : constants [Pa] of the tissue.
    """
    duration = max(float(c.time_s[-1]) for c in curves)
    squares, energies = [], []  # I1 - 3, and the work per volume [Pa], of each curve
    scales: dict[str, float] = {}
    for curve in curves:
        programme, values = programme_of(curve), curve.columns[curve.predicted]
        if curve.kind == "uniaxial":
            squares.append(float(np.max(programme**2 + 2.0 / programme - 3.0)))
            energies.append(_work(programme, values))
            _enlarge(scales, _of_strain(programme - 1.0, values, duration))
        elif curve.kind == "shear":
            squares.append(float(np.max(programme**2)))
            energies.append(_work(programme, values))
            _enlarge(scales, _of_strain(programme, values, duration))
        else:
            assert curve.tool is not None and curve.specimen is not None
            d, F = curve.displacement_m, curve.force_N
            radius_mm = curve.tool.radius_mm
            area = 1e-6 * (curve.specimen.face_mm2 if radius_mm is None else np.pi * radius_mm**2)
            length = 1e-3 * (curve.specimen.thickness_mm if radius_mm is None else radius_mm)
            squares.append(3.0 * min(float(np.abs(d).max()) / length, LARGEST_STRAIN_UNDER_A_TOOL) ** 2)
            energies.append(_work(d, F) / (area * length))
            largest = {"force_N": float(np.abs(F).max()), "displacement_mm": 1e3 * float(np.abs(d).max())}
            height_mm = curve.specimen.thickness_mm
            scales["height_mm"] = min(scales.get("height_mm", height_mm), height_mm)  # a layer must fit into the flattest one
            _enlarge(
                scales,
                {
                    **largest,
                    "pressure_Pa": largest["force_N"] / area,
                    "compliance_mm_N": largest["displacement_mm"] / largest["force_N"],
                    "drift_N_s": largest["force_N"] / duration,
                    "slip_mm_kPa": height_mm / (1e-3 * C10),
                    "radius_mm": 1e3 * length,
                    "edge_mm": max(
                        curve.tool.edge_radius_mm or 0.0,
                        (KNOWN_EDGE_SHARE if curve.tool.edge_radius_mm else SHARP_EDGE_SHARE) * 1e3 * length,
                    ),
                },
            )
    square = max(squares)
    scales |= {
        "duration_s": duration,
        "shortest_s": min(float(c.time_s[-1]) for c in curves),
        "modulus_Pa": C10 + C20 * square,
        "stiffening": 1.0 / float(np.log1p(square / 3.0)),
        "third_Pa": (C10 + 2.0 * C20 * square) / (3.0 * square**2),
        "energy_Pa": max(max(energies), 1e-9),
    }
    # The scales of a tool are asked for without one too, and the other way round, but then nothing is tried in them.
    sought = [entry for effect in EFFECTS.values() for tool in (True, False) for entry in effect.sought_in(tool=tool).values()]
    return Scales({entry.scale: scales.get(entry.scale, 1.0) for entry in sought if entry.scale})


def _of_strain(strain: np.ndarray, stress_Pa: np.ndarray, duration_s: float) -> dict[str, float]:
    largest_strain, largest_Pa = float(np.abs(strain).max()), float(np.abs(stress_Pa).max())
    return {
        "strain": largest_strain,
        "stress_Pa": largest_Pa,
        "drift_Pa_s": largest_Pa / duration_s,
        "strain_per_kPa": largest_strain / (1e-3 * largest_Pa),
    }


def _enlarge(scales: dict[str, float], sizes: dict[str, float]) -> None:
    scales |= {key: max(scales.get(key, value), value) for key, value in sizes.items()}


def _work(programme: np.ndarray, values: np.ndarray) -> float:
    """The largest work that is done along a programme."""
    return float(np.abs(np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(programme))).max())
