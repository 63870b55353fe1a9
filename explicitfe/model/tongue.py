"""TransientScenario -> model: names are looked up, muscles become loads."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from explicitfe.effects.material.viscoelastic import from_damping
from explicitfe.errors import InputError, nearest
from explicitfe.model import catalogue
from explicitfe.model.anatomy import Anatomy
from explicitfe.model.effects import check_effects
from explicitfe.model.gravity import gravity_load
from explicitfe.model.model import FibrePull, Model, NodalLoad
from explicitfe.model.muscles import pull
from explicitfe.model.own_mesh import read_model_file
from explicitfe.scenario.transient import ModelTable, TransientScenario


def anatomy_of(table: ModelTable, folder: Path) -> Anatomy:
    """The anatomy that a ``[model]`` table asks for; paths are relative to ``folder``."""
    if table.file is not None:
        return read_model_file(folder / table.file)
    assert table.name is not None  # the schema has checked that one of the two is there
    return catalogue.built_in(table.name, table.resolution, table.cells)


def assemble(scenario: TransientScenario, folder: Path) -> tuple[Model, Anatomy]:
    """The physics of a scenario whose file lies in ``folder``.

    Raises
    ------
    InputError : a name that does not exist, or a mesh that cannot be computed.
    """
    table = scenario.model
    anatomy = anatomy_of(table, folder)
    mesh = anatomy.mesh
    material = catalogue.material(table.material)

    held = np.zeros((mesh.node_count, 3), dtype=bool)
    for name in anatomy.fixed if table.fixed is None else table.fixed:
        if name not in mesh.node_sets:
            raise InputError(f'model.fixed: unknown node set "{name}"; {nearest(name, mesh.node_sets)}')
        held[mesh.node_sets[name]] = True
    if held.all():
        raise InputError("model.fixed holds every node of the mesh, so nothing can move; take a set out of it.")

    loads: list[NodalLoad] = []
    pulls: list[FibrePull] = []
    for entry in scenario.muscle:
        if entry.name not in anatomy.muscles:
            raise InputError(f'unknown muscle "{entry.name}"; {nearest(entry.name, anatomy.muscles)}')
        load = pull(mesh, anatomy.muscles[entry.name], entry)
        loads.append(load) if isinstance(load, NodalLoad) else pulls.append(load)
    if any(table.gravity_m_s2):
        loads.append(gravity_load(mesh, material, table.gravity_m_s2))

    names = mesh.named_points if scenario.record.probes is None else scenario.record.probes
    for name in names:
        if name not in mesh.named_points:
            raise InputError(f'record.probes: unknown point "{name}"; {nearest(name, mesh.named_points)}')
    model = Model(
        mesh=mesh,
        material=material,
        held=held,
        alpha_per_s=table.damping.alpha_per_s,
        element=table.element,
        loads=tuple(loads),
        pulls=tuple(pulls),
        probes={name: mesh.named_points[name] for name in names},
    )
    if table.damping.beta_s > 0.0:
        if scenario.effects.viscoelastic is not None:
            raise InputError("model.damping.beta_s is a viscoelastic branch itself; give either it or effects.viscoelastic.")
        material, branch = from_damping(material, table.damping.beta_s, 1e-3 * table.damping.tau_ms)
        model = replace(model, material=material, effects=(branch,))
    effects = scenario.effects.chosen
    check_effects((*model.effects, *effects), table.element)
    for effect in effects:
        if effect.acts_on not in ("material", "muscle"):
            raise InputError(
                f"effects: {effect.about.title} belongs to a tool or a specimen; a transient run knows effects of the material "
                "and activation-lag."
            )
        model = effect.apply(model)
    return model, anatomy
