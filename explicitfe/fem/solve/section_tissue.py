"""A tissue in the section of a body of revolution: its material, its state, and what it keeps of the last equilibrium."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from explicitfe.fem.effects import Effect
from explicitfe.fem.effects.complete import complete
from explicitfe.fem.effects.effect import MaterialEffect, Rig, with_leaves
from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import quad9
from explicitfe.fem.solve.point import blocks_at_rest
from explicitfe.fem.solve.section import RevolvedSection
from explicitfe.platform.compiled.simd import WIDTH

# Poisson's ratio of a tissue that keeps its volume: a bulk modulus of a million shear moduli.
CONSTANT_VOLUME_POISSON_RATIO = 0.4999995
# Stiffness of the contact [shear modulus / radius of the tool], and of sticking relative to it; the distance in which the onset
# of contact is rounded [radius of the tool].
PENALTY_OF_CONTACT, PENALTY_OF_STICKING, ROUNDING_OF_CONTACT = 3e3, 0.3, 1e-4


@dataclass(eq=False)
class SectionTissue:
    """A tissue in the section: what it is made of, its present state, and what it keeps of the last equilibrium.

    Attributes
    ----------
    section : the mesh, which follows a layer or an edge that a variant changes.
    blocks, materials : constants, numbers and memory of the material.
    dead, springs : (2 n,) nodal weight [N], and (k, 3, 3) stiffness of the base sideways [N/m].
    profile : of the tool and its contact, see solve/tool_surface.py.
    rig : between machine and tool.
    u, depth, pressures, force : (2 n,) displacements [m], depth of the tool [m], (m, 3) pressures [Pa], force on the tool [N].
    anchors : of the contact, see solve/tool_surface.py.
    touch : depth from which displacements count [m].
    """

    section: RevolvedSection
    blocks: Any
    materials: Sequence[MaterialEffect]
    dead: np.ndarray
    springs: np.ndarray
    profile: np.ndarray
    rig: Rig
    u: np.ndarray
    pressures: np.ndarray
    anchors: np.ndarray
    depth: float = 0.0
    force: float = 0.0
    compression: float = 0.0
    touch: float = 0.0
    lost: bool = False

    @property
    def displacement(self) -> float:
        """Of the machine since first touch [m]."""
        return self.depth - self.compression + self.rig.compliance_m_N * self.force - self.touch


def tissue_in_section(
    section: RevolvedSection, layer_mm: float, specimen: SpecimenTable, tool: ToolTable, law: Yeoh, effects: Sequence[Effect]
) -> SectionTissue:
    """A tissue at rest in a section.

    Parameters
    ----------
    layer_mm : thickness of the layer that the mesh has been made for; a mesh with another layer follows it.
    specimen, tool, law : tables of the test and the elastic law, without effects.
    """
    rig = Rig()
    for effect in effects:
        specimen, tool = effect.prepare(specimen, tool)
        law, rig = effect.in_law(law), effect.on_rig(rig)
    if layer_mm not in (0.0, specimen.layer_mm):  # the lines of the mesh follow the layer
        before, after = (section.height - 1e-3 * layer for layer in (layer_mm, specimen.layer_mm))
        z_lines = np.interp(section.z_lines, [0.0, before, section.height], [0.0, after, section.height])
        section = RevolvedSection(specimen, tool, section.r_lines, z_lines, base_gives_way=section.base_gives_way)
    quads = section.quads
    materials = complete(with_leaves(effects))
    count = quads.weights.size
    blocks = blocks_at_rest(law, materials, count)
    depth = section.height - section.at[:, 1]
    factor = np.ones(count)
    if specimen.layer_mm > 0.0:
        factor[depth < 1e-3 * specimen.layer_mm] = specimen.layer_stiffness_ratio
    for effect in effects:
        factor = factor * effect.stiffness_at(section.at[:, 0], depth, section.height, section.spread)
    lanes = np.ones(len(blocks.nodes) * WIDTH)
    lanes[:count] = factor
    scaled = law.scaled(np.tile(np.array(law.constants(), dtype=float), (len(lanes), 1)), lanes)
    if law.poisson == CONSTANT_VOLUME_POISSON_RATIO:  # one bulk modulus keeps the volume everywhere and the equations symmetric
        scaled[:, -1] = law.constants()[-1]
    blocks.constants[:] = scaled.reshape(-1, WIDTH, scaled.shape[1]).transpose(0, 2, 1)
    dead = np.zeros(2 * len(section.points))
    weight = law.density_kg_m3 * specimen.gravity_m_s2[2] * (quads.weights @ quad9.SHAPE)
    np.add.at(dead, 2 * quads.nodes + 1, weight)
    compliance = sum(effect.base_compliance_m_Pa for effect in effects)
    edges = section.base
    springs = (
        np.einsum("k,ka,kb->kab", edges.areas / compliance, edges.shape, edges.shape) if compliance > 0.0 else np.zeros((0, 3, 3))
    )
    radius = 1e-3 * tool.outer_radius_mm
    platen = tool.shape == "platen"
    edge = {"flat-cylinder": 1e-3 * tool.rounding_mm, "sphere": radius}.get(tool.shape, 0.0)
    size = min(radius, section.height)
    normal = PENALTY_OF_CONTACT * law.shear_modulus_Pa / size
    friction = 1.0 if tool.friction == "stick" else float(tool.friction)
    onset = ROUNDING_OF_CONTACT * size
    profile = np.array(
        [section.height, radius - edge, edge, float(platen), normal, PENALTY_OF_STICKING * normal, friction, onset]
    )
    anchors = np.column_stack([section.surface.places, np.zeros((len(section.surface.places), 2))])
    u, pressures = np.zeros(2 * len(section.points)), np.zeros((len(quads.nodes), quad9.LINEAR))
    return SectionTissue(section, blocks, materials, dead, springs, profile, rig, u, pressures, anchors)


def is_isochoric(effects: Sequence[Effect]) -> bool:
    """Whether no effect changes the volume of the tissue or what it answers to a change."""
    filled = {slot for effect in with_leaves(effects) for slot in effect.leaves()}
    return filled.isdisjoint(("dilate", "drain")) and not any(effect.changes_volume for effect in effects)


def incompressible(law: Yeoh) -> Yeoh:
    """The law of a tissue that keeps its volume."""
    return law.model_copy(update={"poisson": CONSTANT_VOLUME_POISSON_RATIO})
