"""A tissue in a scenario: its constants and effects as the settings of ``--set``, which are stored with the result."""

from __future__ import annotations

from pathlib import Path

from explicitfe.fem.effects import EFFECTS, Effect
from explicitfe.inverse.predict.tissue import EVERY, Constants, Tissue, read_tissue
from explicitfe.platform.errors import InputError, nearest
from explicitfe.platform.host.shipped import scenario_file
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.scenario.indentation import IndentationScenario
from explicitfe.simulate.scenario.read import Scenario, read_scenario
from explicitfe.simulate.scenario.transient import TransientScenario

# A body takes these effects along into a run in time: what they act on is its own.
ACTS_ON_A_BODY = ("material", "muscle")
# A tissue that relaxes by itself takes the place of the branch that damps like Rayleigh's beta.
WITHOUT_BETA = "model.damping.beta_s=0.0"
# A specimen takes along the effects that are there, in the words of their descriptions, whatever the test imposes.
WHERE_IN_A_SPECIMEN = ("material", "specimen", "contact", "boundary")


def tissue_settings(tissue: Tissue, scenario: Scenario, group: str | None = None) -> tuple[list[str], list[str]]:
    """Settings that put a tissue into a scenario.

    Parameters
    ----------
    tissue : constants and effects.
    scenario : as its file states it: its density stays, and so do effects that the tissue does not have.
    group : name of the constants; it may be left out where there is one group.

    Returns
    -------
    settings : ``key=value``, as ``read_scenario`` and ``run`` take them; if the tissue relaxes by itself, without beta.
    left_out : names of effects of the measurement, of the loading, or of what the scenario does not have.

    Raises
    ------
    InputError : there is no such group, or there are several and none is named.
    """
    constants = _constants(tissue, group)
    material = {
        "law": "yeoh",
        **constants.model_dump(),
        "poisson": tissue.poisson,
        "density_kg_m3": catalogue.material(scenario.model.material).density_kg_m3,
    }
    settings, left_out = [f"model.material={toml_value(material)}"], []
    for name, kind in EFFECTS.items():
        effect = getattr(tissue.effects, name.replace("-", "_"))
        if effect is None:
            continue
        if not _belongs(kind, isinstance(scenario, IndentationScenario)):
            left_out.append(name)
            continue
        settings.append(f"effects.{name}={toml_value(effect.model_dump())}")
        relaxes = effect.acts_on == "material" and effect.transient
        if relaxes and isinstance(scenario, TransientScenario) and scenario.model.damping.beta_s > 0.0:
            settings.append(WITHOUT_BETA)
    return settings, left_out


def stored_tissue_settings(scenario: Path, model: Path, group: str | None) -> tuple[list[str], list[str]]:
    """Settings that put the tissue of a model file into the scenario of a file, and notes of what it has and the run does not.

    Raises
    ------
    InputError : a file cannot be read; see ``tissue_settings``.
    """
    tissue, (stated, _) = read_tissue(model), read_scenario(scenario_file(scenario))
    try:
        settings, left_out = tissue_settings(tissue, stated, group)
    except InputError as error:
        raise InputError(f"{model}: {error}") from None
    notes = []
    if left_out:
        notes.append(f"of the effects in {model} these are no part of the run and were left out: {', '.join(left_out)}.")
    if WITHOUT_BETA in settings:
        notes.append(f"the tissue in {model} relaxes by itself, so model.damping.beta_s is 0 in this run.")
    return settings, notes


def _constants(tissue: Tissue, group: str | None) -> Constants:
    groups = list(tissue.constants)
    if group is None and len(groups) == 1:
        return tissue.constants[groups[0]]
    if groups == [EVERY]:
        raise InputError("the model has one set of constants for all; leave the group out.")
    if group is None:
        raise InputError(f"the model has several groups of constants; name one of {', '.join(groups)}.")
    if group not in groups:
        raise InputError(f'the model has no group of constants "{group}"; {nearest(group, groups)}')
    return tissue.constants[group]


def _belongs(kind: type[Effect], under_a_tool: bool) -> bool:
    """Whether an effect goes with the tissue into another run."""
    return kind.about.where in WHERE_IN_A_SPECIMEN if under_a_tool else kind.acts_on in ACTS_ON_A_BODY
