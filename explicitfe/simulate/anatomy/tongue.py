"""The model of a transient scenario: names are resolved, muscles become loads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from explicitfe.fem.effects.material.viscoelastic import from_damping
from explicitfe.fem.inputs.argument import number_like
from explicitfe.fem.inputs.limits import NotNegative
from explicitfe.fem.materials import Law
from explicitfe.fem.mesh.box import box
from explicitfe.fem.mesh.hexmesh import MaterialPoints
from explicitfe.fem.mesh.muscle_lines import locate_in_mesh
from explicitfe.fem.model.fibre_stress import fibre_stress, outside_pull
from explicitfe.fem.model.gravity import gravity_load
from explicitfe.fem.model.interactive import let_volume_change, scale_mass
from explicitfe.fem.model.model import FibrePull, FibreStress, Model, NodalLoad
from explicitfe.fem.model.surface_contact import SurfaceContact
from explicitfe.platform.errors import InputError, nearest, shortened
from explicitfe.results.documents.run_summary import SurgeryReport
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.anatomy.anatomy import Anatomy
from explicitfe.simulate.anatomy.bodies import with_bodies
from explicitfe.simulate.anatomy.bones import attachments, bones_of, check_anchors
from explicitfe.simulate.anatomy.effects import check_effects
from explicitfe.simulate.anatomy.loads import PA_M_PER_KPA_MM, scale_anatomy, with_loads, with_release
from explicitfe.simulate.anatomy.muscles import activation_stiffness, directed, line_pull
from explicitfe.simulate.anatomy.own_mesh import read_model_file
from explicitfe.simulate.anatomy.surgery import operated, surgery_of, surgery_report
from explicitfe.simulate.scenario.bodies import MeshTable
from explicitfe.simulate.scenario.bones import BoneTable
from explicitfe.simulate.scenario.profile import profile_of
from explicitfe.simulate.scenario.transient import AnalysisTable, Damping, ModelTable, MuscleTable, TransientScenario


def anatomy_of(table: MeshTable, folder: Path) -> Anatomy:
    """The anatomy that a ``[model]`` or ``[[body]]`` table asks for; paths are relative to ``folder``."""
    if table.box_mm is not None:
        return _box(table)
    if table.file is not None:
        anatomy = read_model_file(folder / table.file)
        return anatomy if table.scale == (1.0, 1.0, 1.0) else scale_anatomy(anatomy, table.scale)
    assert table.built_in is not None  # the schema has checked that one of the two is given
    return catalogue.built_in(table.built_in, table.resolution, table.cells)


def _box(table: MeshTable) -> Anatomy:
    """A box with a corner at the origin; its faces are node sets, and their centres named points."""
    assert table.box_mm is not None and table.cells is not None  # the schema has checked that both are given
    size_m = 1e-3 * np.array(table.box_mm) * np.array(table.scale)
    mesh = box(table.cells, tuple(size_m))
    centres = {}
    for axis, letter in enumerate("xyz"):
        for side in (0, 1):
            place = 0.5 * size_m
            place[axis] = side * size_m[axis]
            centres[f"{letter}{side}"] = locate_in_mesh(mesh, place)
    return Anatomy(name="box", mesh=replace(mesh, named_points=centres), muscles={}, fixed=("x0",))


class Assembly(NamedTuple):
    """A scenario as physics.

    Attributes
    ----------
    model : what is computed.
    anatomy : the intact body that it was built from.
    surgery : what was taken from it; None where nothing was.
    displacement : (n, 3) m at time 0, of a body that is held until its release; None at rest.
    """

    model: Model
    anatomy: Anatomy
    surgery: SurgeryReport | None = None
    displacement: np.ndarray | None = None


def assemble(scenario: TransientScenario, folder: Path) -> Assembly:
    """The physics of a scenario whose file lies in ``folder``.

    Raises
    ------
    InputError : a name that does not exist, or a mesh that cannot be computed.
    """
    table = scenario.model
    material = catalogue.material(table.material)
    supported = {support.name for support in scenario.support}
    bodies = with_bodies(table, material, scenario.body, supported, folder, anatomy_of)
    anatomy, mesh = bodies.anatomy, bodies.anatomy.mesh

    held = np.zeros((mesh.node_count, 3), dtype=bool)
    fixed = tuple(name for name in (anatomy.fixed if table.fixed is None else table.fixed) if name not in supported)
    for name in fixed:
        if name not in mesh.node_sets:
            raise InputError(f'model.fixed: unknown node set "{name}"; {nearest(name, mesh.node_sets)}')
        if table.attachment == "nodes":
            held[mesh.node_sets[name]] = True
    held[bodies.held] = True
    surgery = surgery_of(scenario, mesh, material, anatomy.element_sets)
    loads: list[NodalLoad] = []
    pulls: list[FibrePull] = []
    stresses: list[FibreStress] = []
    lines_of_muscles: list[tuple[MaterialPoints, ...]] = []
    cut: list[tuple[FibreStress | FibrePull, FibreStress | FibrePull]] = []
    for entry in scenario.muscle:
        if entry.name not in anatomy.muscles:
            raise InputError(f'unknown muscle "{entry.name}"; {nearest(entry.name, anatomy.muscles)}')
        muscle = anatomy.muscles[entry.name]
        if entry.distribution == "stress":
            course, fibres = profile_of(entry), entry.fibres
            part, first = bodies.part_of(entry.name)
            stress = fibre_stress(part, muscle, entry.force_N, entry.side, course, fibres=fibres, force_length=entry.force_length)
            stress = replace(stress, elements=stress.elements + first)
            outside = outside_pull(part, muscle, entry.force_N, entry.side, course, fibres=fibres)
            if surgery is not None:
                cut.append((stress, stress := surgery.left_of_stress(stress)))
                if outside is not None:
                    cut.append((outside, outside := surgery.left_of_lines(outside)))
            stresses.append(stress)
            lines_of_muscles.append(tuple(fibre.points for fibre in muscle.chosen(entry.side, fibres)))
            pulls += [] if outside is None else [bodies.tie(outside, first)]
            continue
        lines = bodies.tie(line_pull(mesh, muscle, entry))
        if surgery is not None:
            cut.append((lines, lines := surgery.left_of_lines(lines, muscle.chosen(entry.side, entry.fibres))))
        lines_of_muscles.append(lines.points)
        load = directed(mesh, lines, entry.direction)
        loads.append(load) if isinstance(load, NodalLoad) else pulls.append(load)

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
        barrier=table.barrier,
        loads=tuple(loads),
        pulls=tuple(pulls),
        stresses=tuple(stresses),
        stiffness=activation_stiffness(mesh, anatomy.muscles, scenario.muscle) if table.activation_stiffening else None,
        bones=bones_of(scenario, mesh, folder),
        attachments=attachments(scenario, mesh, fixed) if table.attachment == "area" else (),
        probes={name: mesh.named_points[name] for name in names},
        fibres=tuple(lines_of_muscles),
        inclusions=bodies.inclusions,
        surfaces=_surfaces(scenario),
        fixed=(*(fixed if table.attachment == "nodes" else ()), *bodies.fixed),
    )
    check_anchors(model.pulls, model.bones)
    report = None
    if surgery is not None:
        intact, model = model, operated(model, surgery)
        report = surgery_report(surgery, intact, model, cut)
    if model.held.all():
        raise InputError("model.fixed fixes every node of the mesh, so nothing can move; remove a set from it.")
    model = with_loads(model, scenario, folder)
    if any(table.gravity_m_s2):
        weight = gravity_load(model.mesh, material, table.gravity_m_s2, model.inclusions, model.masses)
        model = replace(model, loads=(*model.loads, weight))
    if table.speed == "interactive":
        model = let_volume_change(model)
    effects = scenario.effects.chosen
    if table.damping.beta_s > 0.0:
        beta_s, tau_s = table.damping.beta_s, 1e-3 * table.damping.tau_ms
        material, branch = from_damping(model.material, beta_s, tau_s)
        parts = [replace(part, material=from_damping(part.material, beta_s, tau_s)[0]) for part in model.inclusions]
        if any(type(effect) is type(branch) for effect in effects):
            raise InputError("model.damping.beta_s is a viscoelastic branch; use either beta_s or effects.viscoelastic.")
        model = replace(model, material=material, inclusions=tuple(parts), effects=(branch,))
    check_effects((*model.effects, *effects), table.element)
    for effect in effects:
        if effect.acts_on not in ("material", "muscle"):
            raise InputError(
                f"effects: {effect.about.title} is an effect of a tool or specimen; a transient run supports material effects "
                "and activation-lag."
            )
        model = effect.apply(model)
    if table.speed == "interactive":
        model = scale_mass(model)
    model, displacement = with_release(model, scenario.release)
    return Assembly(model, anatomy, report, displacement)


def _surfaces(scenario: TransientScenario) -> SurfaceContact | None:
    if scenario.contact is None:
        return SurfaceContact() if scenario.body else None
    table = scenario.contact
    stiffness = None if table.stiffness_kPa_per_mm is None else PA_M_PER_KPA_MM * table.stiffness_kPa_per_mm
    return SurfaceContact(stiffness, table.friction, table.damping)


def tongue_model(
    forces_N: Mapping[str, float],
    *,
    material: str | Law = "gerard-2005",
    resolution: Literal["coarse", "medium", "fine"] = "medium",
    distribution: Literal["stress", "ends", "along", "volume"] = "stress",
    direction: Literal["reference", "following"] = "reference",
    attachment: Literal["nodes", "area"] = "nodes",
    bones: Sequence[str] = (),
    alpha_per_s: float = 40.0,
    beta_s: float = 0.0,
    speed: Literal["accurate", "interactive"] = "accurate",
) -> Model:
    """The built-in tongue with muscles that pull from time 0 on.

    Parameters
    ----------
    forces_N : muscle -> force summed over all its fibres, N. ``explicitfe list muscles`` prints the names.
    material : a name of ``explicitfe list materials``, or the constants of a law, such as ``Yeoh(...)``.
    resolution : of the mesh: "coarse" (960 elements), "medium" or "fine".
    distribution : how the force acts: as active "stress" in the tissue around the fibres, or as a tension between the "ends" of
        each fibre, constant "along" it, or in proportion to the "volume" of tissue around it (simulate/anatomy/muscles.py).
    direction : of a tension: that of the fibre at rest ("reference") or "following" its deformation.
    attachment : how bones hold the tongue: "nodes" are fixed, or patches are tied by springs in proportion to their "area".
    bones : bones that the tongue may touch: "palate", "jaw".
    alpha_per_s : mass-proportional (Rayleigh) damping, 1/s.
    beta_s : stiffness-proportional damping, s; it acts on the shear of the tissue, through a Maxwell branch.
    speed : "interactive" for steps that are several times as long, with errors of some 0.1 mm (fem/model/interactive.py).

    Returns
    -------
    The model. ``model.probes`` has the named points, such as "tip" and "dorsum"; x points backwards, y to the speaker's right,
    z up.

    Raises
    ------
    InputError : an unknown muscle, material, resolution or bone, or a value outside the limits of the same key of a scenario.
    """
    if not isinstance(forces_N, Mapping):
        raise InputError(f'tongue_model: forces_N must be a dictionary, such as {{"GGp": 2.0}}, not {shortened(repr(forces_N))}.')
    if isinstance(bones, str):
        raise InputError(f'tongue_model: bones must be a list of names, such as ["palate"], not {shortened(repr(bones))}.')
    number_like("tongue_model: alpha_per_s", alpha_per_s, NotNegative, "alpha_per_s")
    number_like("tongue_model: beta_s", beta_s, NotNegative, "beta_s")
    for name, force_N in forces_N.items():
        number_like(f'tongue_model: forces_N["{name}"]', force_N, NotNegative, "force_N")
    scenario = TransientScenario(
        title="tongue",
        model=ModelTable(
            name="tongue",
            resolution=resolution,
            material=material,
            attachment=attachment,
            damping=Damping(alpha_per_s=alpha_per_s, beta_s=beta_s),
            speed=speed,
        ),
        muscle=[
            MuscleTable(name=name, force_N=force, distribution=distribution, direction=direction)
            for name, force in forces_N.items()
        ],
        bone=[BoneTable(name=name) for name in bones],
        analysis=AnalysisTable(duration_ms=1.0),
    )
    return assemble(scenario, Path()).model
