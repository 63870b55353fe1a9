"""What an elastic model lacks: one effect a file, one line an effect in the table below."""

from __future__ import annotations

from explicitfe.fem.effects.effect import Effect, MaterialEffect, Measurement, Rig, physics_of, readings_of, with_leaves
from explicitfe.fem.effects.material.compressible import Compressible
from explicitfe.fem.effects.material.discovered_law import DiscoveredLaw
from explicitfe.fem.effects.material.drainage import Drainage
from explicitfe.fem.effects.material.fibres import Fibres
from explicitfe.fem.effects.material.fractional import Fractional
from explicitfe.fem.effects.material.nonlinear_relaxation import NonlinearRelaxation
from explicitfe.fem.effects.material.payne import Payne
from explicitfe.fem.effects.material.permanent_set import PermanentSet
from explicitfe.fem.effects.material.power_law import PowerLaw
from explicitfe.fem.effects.material.softening import Softening
from explicitfe.fem.effects.material.third_yeoh import ThirdYeoh
from explicitfe.fem.effects.material.viscoelastic import Viscoelastic
from explicitfe.fem.effects.muscle.activation_lag import ActivationLag
from explicitfe.fem.effects.reading.backlash import Backlash
from explicitfe.fem.effects.reading.contact_offset import ContactOffset
from explicitfe.fem.effects.reading.cycle_drift import CycleDrift
from explicitfe.fem.effects.reading.force_drift import ForceDrift
from explicitfe.fem.effects.reading.force_offset import ForceOffset
from explicitfe.fem.effects.reading.gauge_length import GaugeLength
from explicitfe.fem.effects.reading.lag import Lag
from explicitfe.fem.effects.reading.stick_slip import StickSlip
from explicitfe.fem.effects.specimen.base_slip import BaseSlip
from explicitfe.fem.effects.specimen.gravity import Gravity
from explicitfe.fem.effects.specimen.inclusion import InclusionBelowTool
from explicitfe.fem.effects.specimen.layer import Layer
from explicitfe.fem.effects.specimen.stiffness_gradient import StiffnessGradient
from explicitfe.fem.effects.tool.adhesion import Adhesion
from explicitfe.fem.effects.tool.compliance import Compliance
from explicitfe.fem.effects.tool.edge import Edge
from explicitfe.fem.effects.tool.friction import Friction
from explicitfe.fem.effects.tool.preload import Preload
from explicitfe.fem.effects.tool.tilt import Tilt

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
