"""A tissue that stiffens with strain in another way than its law says."""

from __future__ import annotations

from explicitfe.fem.effects.effect import Sought
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.inverse.close_loop.trajectories.lever import Experiment, Lever, Values
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.scenario.transient import TransientScenario

# C20 over C10.
RATIO = Sought((0.3, 1.0, 3.0), 0.0, 30.0)


def levers(test: Experiment) -> dict[str, Lever]:
    """The second constant of a Yeoh law in place of a neo-Hookean law."""
    law = catalogue.material(test.scenario.model.material)
    return {
        "nonlinear-law": Lever(
            "nonlinear-law",
            "second constant of the Yeoh law over the first one",
            {"ratio": RATIO},
            _yeoh,
            reason="" if law.law == "neo-hooke" else "the law has more than one constant already",
        )
    }


def _yeoh(scenario: TransientScenario, v: Values) -> list[str]:
    law = catalogue.material(scenario.model.material)
    C10_Pa = 0.5 * law.shear_modulus_Pa
    table = law.model_dump(exclude_defaults=True, include=set(Yeoh.model_fields) - {"law", "source"})
    return [f"model.material={toml_value({**table, 'law': 'yeoh', 'C10_Pa': C10_Pa, 'C20_Pa': v['ratio'] * C10_Pa})}"]
