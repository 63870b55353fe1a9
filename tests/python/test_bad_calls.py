"""A bad argument of the Python API is refused where it enters, by one sentence that names the parameter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import explicitfe as fe
from explicitfe.fem.model.model import PrescribedMotion

INF, NAN = float("inf"), float("nan")
MESH = fe.box((2, 2, 2), (0.02, 0.02, 0.02))
OTHER = fe.box((4, 4, 4), (0.02, 0.02, 0.02))
N, M = MESH.node_count, MESH.element_count
YEOH = fe.Yeoh(C10_Pa=1037.0, C20_Pa=486.0)
HELD = MESH.held("x0")
LOAD = fe.face_load(MESH, "x1", (0.0, 0.0, -1e-4))
ON = fe.Profile.constant()
SPECIMEN = {"radius_mm": 8.0, "height_mm": 5.0, "edge_size_mm": 0.8, "material": YEOH}


def model(**changed: object) -> fe.Model:
    return fe.Model(**{"mesh": MESH, "material": YEOH, "held": HELD, "loads": (LOAD,)} | changed)


def inclusion(elements: object, material: object = YEOH) -> fe.Model:
    return model(inclusions=(fe.Inclusion(elements, material),))


def load_on(nodes: object, force_N: object = ((0.0, 0.0, 1e-4),)) -> fe.Model:
    return model(loads=(fe.NodalLoad("pull", nodes, force_N, ON),))


def transient(**given: object) -> object:
    """A transient whose samples have begun."""
    every_s = given.pop("every_s", 1e-3)
    run = fe.Transient(fe.Simulation(model()), **{"duration_s": 2e-3} | given)
    return next(iter(run.samples(every_s)))


def relaxation(**given: object) -> fe.Relaxation:
    return fe.Relaxation(model(), **given)


def pressed() -> fe.Relaxation:
    return fe.Relaxation(fe.specimen_model(fe.SpecimenTable(**SPECIMEN), fe.ToolTable(shape="platen")))


# Name -> the call, and a word that the message must have: the parameter.
BAD: dict[str, tuple[Callable[[], object], str]] = {
    # meshes
    "box: cells of zero": (lambda: fe.box((0, 1, 1), (1.0, 1.0, 1.0)), "cells"),
    "box: two cells": (lambda: fe.box((1, 1), (1.0, 1.0, 1.0)), "cells"),
    "box: cells a number": (lambda: fe.box(4, (1.0, 1.0, 1.0)), "cells"),
    "box: float cells": (lambda: fe.box((2.0, 2.0, 2.0), (1.0, 1.0, 1.0)), "cells"),
    "box: more cells than memory": (lambda: fe.box((10**6, 10**6, 10**6), (1.0, 1.0, 1.0)), "cells"),
    "box: negative size": (lambda: fe.box((1, 1, 1), (-1.0, 1.0, 1.0)), "size_m"),
    "box: size a number": (lambda: fe.box((1, 1, 1), 1.0), "size_m"),
    "box: size of text": (lambda: fe.box((1, 1, 1), ("1", "1", "1")), "size_m"),
    "box: infinite size": (lambda: fe.box((1, 1, 1), (INF, 1.0, 1.0)), "size_m"),
    "box: size in mm": (lambda: fe.box((1, 1, 1), (40.0, 20.0, 20.0)), "size_m"),
    "points in two dimensions": (lambda: fe.HexMesh(MESH.points[:, :2], MESH.hexes), "points"),
    "points not finite": (lambda: fe.HexMesh(np.full((N, 3), NAN), MESH.hexes), "points"),
    "points in micrometres": (lambda: fe.HexMesh(1e6 * MESH.points, MESH.hexes), "points"),
    "points of text": (lambda: fe.HexMesh([["a", "b", "c"]], MESH.hexes), "points"),
    "points of several lengths": (lambda: fe.HexMesh([[0.0, 0.0], [1.0]], MESH.hexes), "points"),
    "points complex": (lambda: fe.HexMesh(MESH.points + 1j, MESH.hexes), "points"),
    "no points": (lambda: fe.HexMesh(None, MESH.hexes), "points"),
    "hexes of seven nodes": (lambda: fe.HexMesh(MESH.points, MESH.hexes[:, :7]), "hexes"),
    "hexes of floats": (lambda: fe.HexMesh(MESH.points, MESH.hexes.astype(float)), "hexes"),
    "hexes of truths": (lambda: fe.HexMesh(MESH.points, np.ones((1, 8), dtype=bool)), "hexes"),
    "hexes counted from 1": (lambda: fe.HexMesh(MESH.points, MESH.hexes + 1), "hexes"),
    "hexes negative": (lambda: fe.HexMesh(MESH.points, MESH.hexes - 1), "hexes"),
    "an element twice": (lambda: fe.HexMesh(MESH.points, np.concatenate([MESH.hexes, MESH.hexes[3:4]])), "hexes"),
    "node set a list": (lambda: fe.HexMesh(MESH.points, MESH.hexes, [0, 1]), "node_sets"),
    "node set of floats": (lambda: fe.HexMesh(MESH.points, MESH.hexes, {"a": np.array([0.0])}), "node_sets"),
    "node set out of range": (lambda: fe.HexMesh(MESH.points, MESH.hexes, {"a": np.array([N])}), "node_sets"),
    "node set negative": (lambda: fe.HexMesh(MESH.points, MESH.hexes, {"a": np.array([-1])}), "node_sets"),
    "node set with a node twice": (lambda: fe.HexMesh(MESH.points, MESH.hexes, {"a": np.array([1, 1])}), "node_sets"),
    "node set of a mask": (lambda: fe.HexMesh(MESH.points, MESH.hexes, {"a": np.ones(N, dtype=bool)}), "node_sets"),
    "named point a node": (lambda: fe.HexMesh(MESH.points, MESH.hexes, {}, {"tip": 3}), "named_points"),
    "held: unknown set": (lambda: MESH.held("x9"), "x9"),
    "held: no name": (lambda: MESH.held(0), "node set"),
    "held: unknown axis": (lambda: MESH.held("x0", along="q"), "along"),
    "points at float nodes": (lambda: MESH.points_at_nodes([1.5]), "nodes"),
    "points at missing nodes": (lambda: MESH.points_at_nodes([N]), "nodes"),
    "points at negative nodes": (lambda: MESH.points_at_nodes([-1]), "nodes"),
    "named node out of range": (lambda: MESH.with_named_nodes({"tip": N}), "nodes"),
    "values of other nodes": (lambda: MESH.at(MESH.points_at_nodes([0]), np.zeros((N + 1, 3))), "values"),
    # models
    "mesh is points": (lambda: model(mesh=MESH.points), "mesh"),
    "mesh without elements": (lambda: model(mesh=fe.HexMesh(MESH.points, np.zeros((0, 8), dtype=int))), "mesh"),
    "material by name": (lambda: model(material="yeoh"), "material"),
    "material beyond all units": (lambda: model(material=fe.Yeoh(C10_Pa=1e20, C20_Pa=0.0)), "C10_Pa"),
    "held of node numbers": (lambda: model(held=[0, 1, 2]), "held"),
    "held too short": (lambda: model(held=HELD[:-1]), "held"),
    "held too long": (lambda: model(held=np.zeros((N + 1, 3), dtype=bool)), "held"),
    "held one column": (lambda: model(held=HELD[:, 0]), "held"),
    "held of floats": (lambda: model(held=HELD.astype(float)), "held"),
    "held of integers": (lambda: model(held=HELD.astype(int)), "held"),
    "held None": (lambda: model(held=None), "held"),
    "held a name": (lambda: model(held="x0"), "held"),
    "alpha negative": (lambda: model(alpha_per_s=-50), "alpha_per_s"),
    "alpha infinite": (lambda: model(alpha_per_s=INF), "alpha_per_s"),
    "alpha not a number": (lambda: model(alpha_per_s=NAN), "alpha_per_s"),
    "alpha beyond all rates": (lambda: model(alpha_per_s=1e9), "alpha_per_s"),
    "alpha text": (lambda: model(alpha_per_s="40"), "alpha_per_s"),
    "element unknown": (lambda: model(element="hex20"), "element"),
    "element a number": (lambda: model(element=8), "element"),
    "one load alone": (lambda: model(loads=LOAD), "loads"),
    "load a force": (lambda: model(loads=[(0.0, 0.0, 1.0)]), "loads"),
    "probes a list": (lambda: model(probes=[0]), "probes"),
    "probe a node": (lambda: model(probes={"tip": 3}), "probes"),
    "stiffness too short": (lambda: model(stiffness=np.ones(M - 1)), "stiffness"),
    "stiffness negative": (lambda: model(stiffness=-np.ones(M)), "stiffness"),
    "stiffness zero": (lambda: model(stiffness=np.zeros(M)), "stiffness"),
    "stiffness infinite": (lambda: model(stiffness=np.full(M, INF)), "stiffness"),
    "stiffness a number": (lambda: model(stiffness=2.0), "stiffness"),
    "copies of none": (lambda: model(copies=0.0), "copies"),
    "copies negative": (lambda: model(copies=-4), "copies"),
    "effects by name": (lambda: model(effects=("viscoelastic",)), "effects"),
    "tool a table": (lambda: model(tool=fe.ToolTable(shape="platen")), "tool"),
    "motion of missing nodes": (lambda: model(motion=PrescribedMotion(np.array([N]), lambda time_s: None)), "motion"),
    "motion a function": (lambda: model(motion=lambda t: t), "motion"),
    "inclusion negative": (lambda: inclusion([-1]), "elements"),
    "inclusion out of range": (lambda: inclusion([M]), "inclusions"),
    "inclusion of floats": (lambda: inclusion([1.0, 2.0]), "elements"),
    "inclusion of halves": (lambda: inclusion(np.array([0.5])), "elements"),
    "inclusion with an element twice": (lambda: inclusion([1, 1]), "elements"),
    "inclusion of a mask": (lambda: inclusion(np.ones(M, dtype=bool)), "elements"),
    "inclusion of one number": (lambda: inclusion(3), "elements"),
    "inclusion in two dimensions": (lambda: inclusion([[0, 1]]), "elements"),
    "inclusion without tissue": (lambda: inclusion([0], None), "material"),
    "inclusion of another law": (
        lambda: inclusion([0], fe.MooneyRivlin(law="mooney-rivlin", C10_Pa=500.0, C01_Pa=500.0)), "inclusions"
    ),
    "an element in two inclusions": (
        lambda: model(inclusions=(fe.Inclusion([0, 1], YEOH), fe.Inclusion([1], YEOH))), "inclusions"
    ),
    "inclusions of numbers": (lambda: model(inclusions=[0, 1]), "inclusions"),
    # loads
    "load on a missing node": (lambda: load_on([N]), "loads"),
    "load on a negative node": (lambda: load_on([-1]), "nodes"),
    "load on float nodes": (lambda: load_on([0.0]), "nodes"),
    "load without a force for each node": (lambda: load_on([0, 1]), "force_N"),
    "load of a number": (lambda: load_on([0], 1.0), "force_N"),
    "load infinite": (lambda: load_on([0], [[INF, 0.0, 0.0]]), "force_N"),
    "load of a meganewton": (lambda: load_on([0], [[1e6, 0.0, 0.0]]), "force_N"),
    "load with a number as profile": (lambda: fe.NodalLoad("pull", [0], [[0.0, 0.0, 1.0]], 1.0), "profile"),
    "face load of a number": (lambda: fe.face_load(MESH, "x1", 1.0), "force_N"),
    "face load in two dimensions": (lambda: fe.face_load(MESH, "x1", (1.0, 0.0)), "force_N"),
    "face load not a number": (lambda: fe.face_load(MESH, "x1", (NAN, 0.0, 0.0)), "force_N"),
    "face load on no mesh": (lambda: fe.face_load(MESH.points, "x1", (1.0, 0.0, 0.0)), "mesh"),
    "face load with a false profile": (lambda: fe.face_load(MESH, "x1", (0.0, 0.0, 1.0), 1.0), "profile"),
    "gravity a number": (lambda: fe.gravity_load(MESH, YEOH, -9.81), "acceleration_m_s2"),
    "gravity infinite": (lambda: fe.gravity_load(MESH, YEOH, (0.0, 0.0, INF)), "acceleration_m_s2"),
    "gravity of a centrifuge": (lambda: fe.gravity_load(MESH, YEOH, (0.0, 0.0, 1e6)), "acceleration_m_s2"),
    "gravity without tissue": (lambda: fe.gravity_load(MESH, None, (0.0, 0.0, -9.81)), "material"),
    "profile backwards": (lambda: fe.Profile([1.0, 0.0], [0.0, 1.0]), "time_s"),
    "profile of two lengths": (lambda: fe.Profile([0.0, 1.0], [1.0]), "scale"),
    "profile empty": (lambda: fe.Profile([], []), "time_s"),
    "profile not a number": (lambda: fe.Profile([0.0], [NAN]), "scale"),
    "profile with a negative lag": (lambda: fe.Profile([0.0], [1.0], -1.0), "lag_s"),
    "step that ends early": (lambda: fe.Profile.step(0.1, 0.05), "end_s"),
    "step with a negative rise": (lambda: fe.Profile.step(0.0, 1.0, -0.1), "rise_s"),
    "step at no time": (lambda: fe.Profile.step(NAN), "start_s"),
    # tables and models that come with the program
    "specimen of negative radius": (lambda: fe.SpecimenTable(radius_mm=-1.0, height_mm=2.0), "radius_mm"),
    "specimen of an unknown key": (lambda: fe.SpecimenTable(radius=1.0), "radius"),
    "specimen in metres": (lambda: fe.SpecimenTable(radius_mm=1e-4, height_mm=2.0), "radius_mm"),
    "tool without a radius": (lambda: fe.ToolTable(shape="sphere"), "radius_mm"),
    "tool of an unknown shape": (lambda: fe.ToolTable(shape="cone"), "shape"),
    "specimen model of dictionaries": (lambda: fe.specimen_model(SPECIMEN, {"shape": "platen"}), "specimen"),
    "tongue with a list": (lambda: fe.tongue_model(["GGp"]), "forces_N"),
    "tongue with a muscle that pushes": (lambda: fe.tongue_model({"GGp": -1.0}), "forces_N"),
    "tongue with an unknown muscle": (lambda: fe.tongue_model({"GGx": 1.0}), "GGx"),
    "tongue with negative damping": (lambda: fe.tongue_model({"GGp": 1.0}, alpha_per_s=-1.0), "alpha_per_s"),
    "tongue with an unknown resolution": (lambda: fe.tongue_model({"GGp": 1.0}, resolution="huge"), "resolution"),
    "tongue with an unknown distribution": (lambda: fe.tongue_model({"GGp": 1.0}, distribution="even"), "distribution"),
    "tongue with one bone": (lambda: fe.tongue_model({"GGp": 1.0}, bones="palate"), "bones"),
    # solvers
    "save of a model": (lambda: fe.save(model(), "x", duration_s=1.0), "simulation"),
    "save of no time": (lambda: fe.save(fe.Simulation(model()), "x", duration_s=0.0), "duration_s"),
    "save of negative steps": (lambda: fe.save(fe.Simulation(model()), "x", duration_s=1.0, step_s=-1.0), "step_s"),
    "save in no path": (lambda: fe.save(fe.Simulation(model()), 3, duration_s=1.0), "path"),
    "bone of flat points": (lambda: fe.Bone.of_surface("b", np.zeros((4, 2)), np.zeros((1, 3), int), MESH), "points_m"),
    "bone of triangles in halves": (
        lambda: fe.Bone.of_surface("b", np.zeros((4, 3)), np.full((1, 3), 0.5), MESH), "triangles"
    ),
    "bone for no mesh": (lambda: fe.Bone.of_surface("b", np.zeros((4, 3)), np.zeros((1, 3), int), 1), "mesh"),
    "bone with negative friction": (lambda: fe.Bone("b", None, None, friction=-1), "friction"),
    "bone with friction as text": (lambda: fe.Bone("b", None, None, friction="1"), "friction"),
    "bone with true damping": (lambda: fe.Bone("b", None, None, damping=True), "damping"),
    "mass of no star": (lambda: fe.AttachedMass("m", [0], [1e308]), "mass_kg"),
    "weight with shares of 7": (lambda: fe.HangingWeight("w", [0, 1], [3.0, 4.0], 0.01, (0, 0, -9.81)), "share"),
    "weight with a negative share": (lambda: fe.HangingWeight("w", [0, 1], [-1.0, 2.0], 0.01, (0, 0, -9.81)), "share"),
    "weight of a star": (lambda: fe.HangingWeight("w", [0], [1.0], 1e308, (0, 0, -9.81)), "mass_kg"),
    "air like lead": (lambda: fe.AirDrag(quadratic_kg_m3=1e308), "quadratic_kg_m3"),
    "law of a number": (lambda: fe.register_law(1), "register_law"),
    "effect of a number": (lambda: fe.register_effect("one")(1), "register_effect"),
    "sweep over bytes": (lambda: fe.sweep("vowel-i", {"muscle.GGp.force_N": b"x"}), "force_N"),
    "points of another mesh": (lambda: MESH.at(OTHER.points_at_nodes([OTHER.node_count - 1]), np.zeros(N)), "points"),
    "number beyond floats": (lambda: transient(duration_s=10**400), "duration_s"),
    "relaxation with air": (lambda: fe.Relaxation(model(air=fe.AirDrag(1.0))), "air"),
    "relaxation with contact": (lambda: fe.Relaxation(model(surfaces=fe.SurfaceContact(1e7, 0.5e-3))), "surfaces"),
    "simulation of a mesh": (lambda: fe.Simulation(MESH), "model"),
    "simulation with a short displacement": (lambda: fe.Simulation(model(), displacement=np.zeros((N - 1, 3))), "displacement"),
    "simulation with an infinite velocity": (lambda: fe.Simulation(model(), velocity=np.full((N, 3), INF)), "velocity"),
    "simulation with no thread": (lambda: fe.Simulation(model(), threads=0), "threads"),
    "simulation with half a thread": (lambda: fe.Simulation(model(), threads=0.5), "threads"),
    "simulation with many threads": (lambda: fe.Simulation(model(), threads=10**6), "threads"),
    "simulation of inverted elements": (
        lambda: fe.Simulation(model(mesh=fe.HexMesh(MESH.points * [-1.0, 1.0, 1.0], MESH.hexes, MESH.node_sets))), "element"
    ),
    "transient of a model": (lambda: fe.Transient(model(), 0.1), "simulation"),
    "duration negative": (lambda: transient(duration_s=-1), "duration_s"),
    "duration zero": (lambda: transient(duration_s=0.0), "duration_s"),
    "duration infinite": (lambda: transient(duration_s=INF), "duration_s"),
    "duration in ms": (lambda: transient(duration_s=1e5), "duration_s"),
    "duration text": (lambda: transient(duration_s="1"), "duration_s"),
    "step negative": (lambda: transient(step_s=-1e-6), "step_s"),
    "step zero": (lambda: transient(step_s=0.0), "step_s"),
    "every negative": (lambda: transient(every_s=-1), "every_s"),
    "every zero": (lambda: transient(every_s=0), "every_s"),
    "every not a number": (lambda: transient(every_s=NAN), "every_s"),
    "recordings at no distance": (lambda: fe.Transient(fe.Simulation(model()), 2e-3).recordings(0.0), "every_s"),
    "advance to no time": (lambda: fe.Transient(fe.Simulation(model()), 2e-3).advance_to(NAN), "time_s"),
    "advance backwards": (lambda: fe.Simulation(model()).advance(-1, 1e-6), "steps"),
    "advance by a negative step": (lambda: fe.Simulation(model()).advance(1, -1e-6), "dt_s"),
    "start with an infinite step": (lambda: fe.Simulation(model()).start(INF), "dt_s"),
    "tolerance infinite": (lambda: relaxation(tolerance=INF), "tolerance"),
    "tolerance zero": (lambda: relaxation(tolerance=0.0), "tolerance"),
    "tolerance negative": (lambda: relaxation(tolerance=-1e-4), "tolerance"),
    "tolerance of one": (lambda: relaxation(tolerance=1.0), "tolerance"),
    "relaxation with no thread": (lambda: relaxation(threads=0), "threads"),
    "relaxation of a mesh": (lambda: fe.Relaxation(MESH), "model"),
    "press without a tool": (lambda: relaxation().press(0.1), "tool"),
    "press with no force": (lambda: pressed().press(NAN), "force_N"),
    "press with a meganewton": (lambda: pressed().press(1e6), "force_N"),
    "move a kilometre": (lambda: pressed().move(1e3), "displacement_m"),
    "press before the last load": (lambda: pressed().press(0.0, at_s=-1.0), "at_s"),
}  # fmt: skip


def test_there_are_many():
    assert len(BAD) >= 86


@pytest.mark.parametrize("name", BAD)
def test_a_bad_argument_is_named(name: str):
    call, parameter = BAD[name]
    with pytest.raises(fe.InputError) as raised:
        call()
    said = str(raised.value)
    assert parameter in said
    assert "\n" not in said and len(said) < 400
    assert said.endswith((".", "?"))


def test_a_mesh_keeps_its_own_arrays():
    points, hexes, nodes = MESH.points.copy(), MESH.hexes.copy(), np.array([0, 1])
    mesh = fe.HexMesh(points, hexes, {"a": nodes})
    points[:], hexes[:], nodes[:] = 0.0, 0, 5
    assert np.array_equal(mesh.points, MESH.points) and np.array_equal(mesh.hexes, MESH.hexes)
    assert mesh.node_sets["a"].tolist() == [0, 1]
    with pytest.raises(ValueError, match="read-only"):
        mesh.points[0, 0] = 1.0


def test_a_model_keeps_its_own_arrays():
    held, stiffness, force = HELD.copy(), np.ones(M), np.zeros((1, 3))
    own = model(held=held, stiffness=stiffness, loads=[fe.NodalLoad("pull", [0], force)])
    held[:], stiffness[:], force[:] = True, 9.0, 9.0
    assert np.array_equal(own.held, HELD) and (own.stiffness == 1.0).all() and (own.loads[0].force_N == 0.0).all()


@pytest.mark.parametrize("kind", ["float32", "float64", "int64", ">f8", "list", "Fortran"])
def test_points_of_any_type_become_those_that_kernels_are_compiled_for(kind: str):
    """Otherwise each kernel is compiled again for the other type."""
    points = np.rint(100.0 * MESH.points)
    given = points.tolist() if kind == "list" else np.asfortranarray(points) if kind == "Fortran" else points.astype(kind)
    mesh = fe.HexMesh(given, MESH.hexes.astype("int32"))
    assert mesh.points.dtype == np.float64 and mesh.points.dtype.isnative and mesh.points.flags.c_contiguous
    assert mesh.hexes.dtype == np.int64
    assert np.array_equal(mesh.points, points)


def test_a_variant_of_a_mesh_copies_nothing():
    from dataclasses import replace

    other = replace(MESH, named_points={"tip": MESH.points_at_nodes([0])})
    assert other.points is MESH.points and other.hexes is MESH.hexes
