"""Compliance of the clamp: fixed nodes are replaced by an elastic foundation."""

from __future__ import annotations

from collections.abc import Callable

from explicitfe.fem.effects.effect import Sought
from explicitfe.inverse.close_loop.trajectories.lever import Experiment, Lever, Values
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.scenario.transient import TransientScenario

# Compliance relative to the body's own, extent over Young's modulus.
COMPLIANCE_SHARES = (0.005, 0.02, 0.08)
LARGEST_COMPLIANCE_SHARE = 1.0
# The direction that is not sought is so compliant: practically rigid, and soft enough for the usual time step.
RIGID_SHARE = 1.0 / 2000.0


def levers(test: Experiment) -> dict[str, Lever]:
    """Compliance along the normal of the held patches, by which they turn, and along the patches, by which they shift."""
    fixed = test.anatomy.fixed if test.scenario.model.fixed is None else tuple(test.scenario.model.fixed)
    unit = 1e3 * test.extent_m / (3e-3 * catalogue.material(test.scenario.model.material).shear_modulus_Pa)  # mm/kPa
    reason = ""
    if test.scenario.model.name is not None or test.scenario.support or not fixed:
        reason = "the scenario has no fixed nodes of a box or a mesh file"
    sought = {
        "compliance_mm_kPa": Sought(tuple(share * unit for share in COMPLIANCE_SHARES), 0.0, LARGEST_COMPLIANCE_SHARE * unit)
    }

    def soft(normal: bool, tangential: bool) -> Callable[[TransientScenario, Values], list[str]]:
        def settings(scenario: TransientScenario, v: Values) -> list[str]:
            compliance = max(v["compliance_mm_kPa"], RIGID_SHARE * unit)
            stiffness = [1.0 / (compliance if is_soft else RIGID_SHARE * unit) for is_soft in (normal, tangential)]
            names = dict(zip(("normal_kPa_per_mm", "tangential_kPa_per_mm"), stiffness, strict=True))
            return [f"support.+={toml_value({'name': name, **names})}" for name in fixed]

        return settings

    return {
        "clamp-compliance": Lever(
            "clamp-compliance",
            "compliance of the clamp, the same in all directions [mm/kPa]",
            sought,
            soft(True, True),
            reason=reason,
        ),
        "clamp-rotation": Lever(
            "clamp-compliance",
            "compliance of the clamp along its normal, by which it turns [mm/kPa]",
            sought,
            soft(True, False),
            reason=reason,
        ),
        "clamp-translation": Lever(
            "clamp-compliance",
            "compliance of the clamp along its surface, by which it shifts [mm/kPa]",
            sought,
            soft(False, True),
            reason=reason,
        ),
    }
