"""Air, and the losses of a tube: friction and heat at its walls, yielding walls, radiation at its mouth.

All are functions of the complex frequency s in rad/s: s = i omega for a steady tone, and a free vibration goes as exp(s t).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

Frequency = TypeVar("Frequency", complex, np.ndarray)

# Air in the vocal tract (Flanagan 1972, Speech Analysis Synthesis and Perception; figures as in Praat's VocalTract_to_Spectrum
# by P. Boersma, but for the speed of sound, where Story, Titze & Hoffman (1996) have 350 m/s).
SPEED_OF_SOUND_M_S = 350.0
AIR_DENSITY_KG_M3 = 1.14
AIR_VISCOSITY_PA_S = 1.86e-5
HEAT_CONDUCTION_CAL_M_S_K = 0.0055
HEAT_CAPACITY_CAL_KG_K = 240.0
HEAT_CAPACITY_RATIO = 1.4
# Perimeter of a section over that of the circle of the same area (Praat, as above): sections of the tract are flat.
PERIMETER_RATIO = 2.0
# Walls (M. M. Sondhi, J. Schroeter 1987, IEEE Trans. ASSP-35:955-967): resistance over mass, the frequency at which they swing
# without air, and the lowest frequency of a tract that is closed at both ends, all in rad/s.
WALL_RESISTANCE_OVER_MASS_PER_S = 130.0 * np.pi
WALL_FREQUENCY_RAD_S = 30.0 * np.pi
CLOSED_TRACT_FREQUENCY_RAD_S = 406.0 * np.pi


@dataclass(frozen=True)
class Losses:
    """Losses of a tube; all by default.

    Attributes
    ----------
    viscosity : friction in the boundary layer at the wall.
    heat : conduction of heat from the air to the wall.
    walls : the walls give way.
    radiation : the sound that leaves the mouth; without it the pressure there is 0.
    """

    viscosity: bool = True
    heat: bool = True
    walls: bool = True
    radiation: bool = True


ALL_LOSSES = Losses()
LOSSLESS = Losses(viscosity=False, heat=False, walls=False, radiation=False)


def series_impedance(s: Frequency, area: float, losses: Losses) -> Frequency:
    """Pressure drop over flow per metre of a tube, Pa s/m4: its inertance, and friction in the boundary layer.

    The layer is thin against the tube: perimeter / area^2 sqrt(s rho mu) (Flanagan 1972, section 3.2, where s = i omega).
    """
    inertance = s * AIR_DENSITY_KG_M3 / area
    if not losses.viscosity:
        return inertance
    return inertance + perimeter(area) / area**2 * np.sqrt(s * AIR_DENSITY_KG_M3 * AIR_VISCOSITY_PA_S)


def shunt_admittance(s: Frequency, area: float, losses: Losses) -> Frequency:
    """Flow lost over pressure per metre of a tube, m2/(Pa s): its compliance, heat conduction, and yielding walls.

    Heat: perimeter (gamma - 1) / (rho c^2) sqrt(s lambda / (c_p rho)) (Flanagan 1972, section 3.2). Walls: those of Sondhi and
    Schroeter (1987), whose compliance goes with the volume of the air beside them.
    """
    stiffness = AIR_DENSITY_KG_M3 * SPEED_OF_SOUND_M_S**2
    admittance = s * area / stiffness
    if losses.heat:
        diffusivity = HEAT_CONDUCTION_CAL_M_S_K / (HEAT_CAPACITY_CAL_KG_K * AIR_DENSITY_KG_M3)
        admittance = admittance + perimeter(area) * (HEAT_CAPACITY_RATIO - 1.0) / stiffness * np.sqrt(s * diffusivity)
    if losses.walls:
        swing = s * (s + WALL_RESISTANCE_OVER_MASS_PER_S) + WALL_FREQUENCY_RAD_S**2
        admittance = admittance + area / stiffness * s * CLOSED_TRACT_FREQUENCY_RAD_S**2 / swing
    return admittance


def radiation_impedance(s: Frequency, area: float, losses: Losses) -> Frequency:
    """Pressure over flow at a mouth of an area, Pa s/m3: a piston in a plane, as a resistance and an inertance in parallel.

    128 rho c / (9 pi^2 A) and 8 rho / (3 pi sqrt(pi A)) (Flanagan 1972, section 3.3; as in Story's programs).
    """
    if not losses.radiation:
        return 0.0 * s
    resistance = 128.0 * AIR_DENSITY_KG_M3 * SPEED_OF_SOUND_M_S / (9.0 * np.pi**2 * area)
    reactance = s * 8.0 * AIR_DENSITY_KG_M3 / (3.0 * np.pi * np.sqrt(np.pi * area))
    return resistance * reactance / (resistance + reactance)


def perimeter(area: float) -> float:
    """Perimeter of a section of an area m2, m."""
    return PERIMETER_RATIO * 2.0 * float(np.sqrt(np.pi * area))
