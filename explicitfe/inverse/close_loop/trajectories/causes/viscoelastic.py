"""Relaxation of the tissue by one term of a Prony series, without a change of its long-term stiffness."""

from __future__ import annotations

from explicitfe.fem.effects.effect import Sought
from explicitfe.fem.effects.material.viscoelastic import Viscoelastic
from explicitfe.inverse.close_loop.trajectories.lever import Experiment, Lever, Values, material_times
from explicitfe.platform.errors import InputError
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.simulate.anatomy.effects import check_effects
from explicitfe.simulate.scenario.transient import TransientScenario

G = Sought((0.05, 0.15, 0.4), 0.0, 0.9, kind="rest")
# Relaxation times as shares of the duration of a curve.
TAU_SHARES = (0.003, 0.03, 0.3)


def levers(test: Experiment) -> dict[str, Lever]:
    """The share of the sudden stress that relaxes, and the relaxation time."""
    T = test.duration_s
    tau = Sought(tuple(share * T for share in TAU_SHARES), 1e-4 * T, 2.0 * T, kind="log")
    return {
        "viscoelastic": Lever(
            "viscoelastic",
            "share of the sudden stress that relaxes, and relaxation time [s]",
            {"g": G, "tau_s": tau},
            _with_relaxation,
            reason=_no_relaxation(test.scenario),
        )
    }


def _with_relaxation(scenario: TransientScenario, v: Values) -> list[str]:
    """The sudden moduli are larger, so that those after a long time are as they were."""
    return [
        f"model.material={material_times(scenario.model.material, 1.0 / (1.0 - v['g']))}",
        f"effects.viscoelastic={toml_value({'g': [v['g']], 'tau_s': [v['tau_s']]})}",
    ]


def _no_relaxation(scenario: TransientScenario) -> str:
    chosen, branch = scenario.effects.chosen, Viscoelastic(g=(0.1,), tau_s=(0.1,))
    try:
        check_effects((branch, *chosen), scenario.model.element)
    except InputError as error:
        return str(error)
    taken = scenario.model.damping.beta_s > 0.0 or any(type(effect) is type(branch) for effect in chosen)
    return "the scenario already has relaxation or model.damping.beta_s" if taken else ""
