"""What an elastic model lacks: one effect a file, one line an effect in the table below."""

from __future__ import annotations

from explicitfe.effects.effect import Effect, MaterialEffect, Measurement, Rig, physics_of, readings_of, with_leaves
from explicitfe.effects.material.compressible import Compressible
from explicitfe.effects.material.discovered_law import DiscoveredLaw
from explicitfe.effects.material.drainage import Drainage
from explicitfe.effects.material.fibres import Fibres
from explicitfe.effects.material.fractional import Fractional
from explicitfe.effects.material.nonlinear_relaxation import NonlinearRelaxation
from explicitfe.effects.material.payne import Payne
from explicitfe.effects.material.permanent_set import PermanentSet
from explicitfe.effects.material.power_law import PowerLaw
from explicitfe.effects.material.softening import Softening
from explicitfe.effects.material.third_yeoh import ThirdYeoh
from explicitfe.effects.material.viscoelastic import Viscoelastic
from explicitfe.effects.muscle.activation_lag import ActivationLag
from explicitfe.effects.reading.backlash import Backlash
from explicitfe.effects.reading.contact_offset import ContactOffset
from explicitfe.effects.reading.cycle_drift import CycleDrift
from explicitfe.effects.reading.force_drift import ForceDrift
from explicitfe.effects.reading.force_offset import ForceOffset
from explicitfe.effects.reading.gauge_length import GaugeLength
from explicitfe.effects.reading.lag import Lag
from explicitfe.effects.reading.stick_slip import StickSlip
from explicitfe.effects.specimen.base_slip import BaseSlip
from explicitfe.effects.specimen.gravity import Gravity
from explicitfe.effects.specimen.inclusion import InclusionBelowTool
from explicitfe.effects.specimen.layer import Layer
from explicitfe.effects.specimen.stiffness_gradient import StiffnessGradient
from explicitfe.effects.tool.adhesion import Adhesion
from explicitfe.effects.tool.compliance import Compliance
from explicitfe.effects.tool.edge import Edge
from explicitfe.effects.tool.friction import Friction
from explicitfe.effects.tool.preload import Preload
from explicitfe.effects.tool.tilt import Tilt

EFFECTS: dict[str, type[Effect]] = {
    "viscoelastic": Viscoelastic,
    "nonlinear-relaxation": NonlinearRelaxation,
    "power-law": PowerLaw,
    "fractional": Fractional,
    "softening": Softening,
    "permanent-set": PermanentSet,
    "payne": Payne,
    "third-yeoh": ThirdYeoh,
    "fibres": Fibres,
    "compressible": Compressible,
    "drainage": Drainage,
    "discovered-law": DiscoveredLaw,
    "layer": Layer,
    "stiffness-gradient": StiffnessGradient,
    "inclusion": InclusionBelowTool,
    "friction": Friction,
    "adhesion": Adhesion,
    "base-slip": BaseSlip,
    "tilt": Tilt,
    "edge": Edge,
    "preload": Preload,
    "gravity": Gravity,
    "activation-lag": ActivationLag,
    "contact-offset": ContactOffset,
    "compliance": Compliance,
    "force-drift": ForceDrift,
    "force-offset": ForceOffset,
    "cycle-drift": CycleDrift,
    "gauge-length": GaugeLength,
    "lag": Lag,
    "backlash": Backlash,
    "stick-slip": StickSlip,
}


def cause_of(name: str) -> str:
    """The cause of which an effect is a form, by the name of its usual form: relaxation by a power law is viscoelastic.

    An effect without forms, or one that is not in the table, is a cause of its own.
    """
    effect = EFFECTS.get(name)
    return (effect.variant_of or effect.extends or name) if effect is not None else name


__all__ = ["EFFECTS", "Effect", "MaterialEffect", "Measurement", "Rig", "cause_of", "physics_of", "readings_of", "with_leaves"]
