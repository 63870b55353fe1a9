"""What an elastic model lacks: one effect a file, one line an effect in the table below."""

from __future__ import annotations

from explicitfe.effects.activation_lag import ActivationLag
from explicitfe.effects.adhesion import Adhesion
from explicitfe.effects.base_slip import BaseSlip
from explicitfe.effects.compliance import Compliance
from explicitfe.effects.compressible import Compressible
from explicitfe.effects.contact_offset import ContactOffset
from explicitfe.effects.cycle_drift import CycleDrift
from explicitfe.effects.drainage import Drainage
from explicitfe.effects.effect import Effect, MaterialEffect, Measurement
from explicitfe.effects.fibres import Fibres
from explicitfe.effects.force_drift import ForceDrift
from explicitfe.effects.force_offset import ForceOffset
from explicitfe.effects.friction import Friction
from explicitfe.effects.gravity import Gravity
from explicitfe.effects.layer import Layer
from explicitfe.effects.preload import Preload
from explicitfe.effects.softening import Softening
from explicitfe.effects.stiffness_gradient import StiffnessGradient
from explicitfe.effects.third_yeoh import ThirdYeoh
from explicitfe.effects.tilt import Tilt
from explicitfe.effects.viscoelastic import Viscoelastic

EFFECTS: dict[str, type[Effect]] = {
    "viscoelastic": Viscoelastic,
    "softening": Softening,
    "third-yeoh": ThirdYeoh,
    "fibres": Fibres,
    "compressible": Compressible,
    "drainage": Drainage,
    "layer": Layer,
    "stiffness-gradient": StiffnessGradient,
    "friction": Friction,
    "adhesion": Adhesion,
    "base-slip": BaseSlip,
    "tilt": Tilt,
    "preload": Preload,
    "gravity": Gravity,
    "activation-lag": ActivationLag,
    "contact-offset": ContactOffset,
    "compliance": Compliance,
    "force-drift": ForceDrift,
    "force-offset": ForceOffset,
    "cycle-drift": CycleDrift,
}

__all__ = ["EFFECTS", "Effect", "MaterialEffect", "Measurement"]
