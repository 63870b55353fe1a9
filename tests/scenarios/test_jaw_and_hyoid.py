"""What belongs to the jaw moves with it, by so much as a scenario says, and the hyoid bone hangs on its springs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support import ROOT

from explicitfe.fem.model.model import Model
from explicitfe.platform.errors import InputError
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.anatomy.bones import check_anchors, jaw_motion
from explicitfe.simulate.anatomy.tongue import assemble
from explicitfe.simulate.scenario.bones import GLIDE_MM_PER_DEG
from explicitfe.simulate.scenario.read import read_scenario
from explicitfe.simulate.scenario.transient import TransientScenario

MM = 1e-3
INCISOR, HINGE = np.array([53.5, 0.0, 95.0]) * MM, np.array([136.0, 0.0, 138.0]) * MM


def scenario(*settings: str) -> TransientScenario:
    read, _ = read_scenario(ROOT / "scenarios" / "sty-alone.toml", ["model.resolution=coarse", *settings])
    assert isinstance(read, TransientScenario)
    return read


def end_of(point_m: np.ndarray, *settings: str) -> np.ndarray:
    """Where the jaw takes a point of it, (3,) m."""
    motion = jaw_motion(scenario(*settings))
    assert motion is not None
    rotation, shift = motion.placement(np.array([1.0]))
    return rotation[0] @ point_m + shift[0]


def test_the_built_in_jaw_tells_its_incisors():
    """The edge of the teeth in front: the highest of the surface at 0 degrees is at its height, and it is near to the tip."""
    shape = catalogue.bones("tongue")["jaw"]
    np.testing.assert_allclose(shape.incisor_m, INCISOR, atol=1e-12)
    points = shape.surface.points
    front = points[(np.abs(points[:, 1]) < 1.0 * MM) & (points[:, 0] < 60.0 * MM)]
    assert front[:, 2].max() == pytest.approx(INCISOR[2], abs=0.5 * MM)
    assert catalogue.bones("tongue")["palate"].incisor_m is None


@pytest.mark.parametrize("opening_mm", [-5.0, 0.0, 3.0, 20.0, 40.0])
def test_an_opening_lowers_the_incisors_by_so_much(opening_mm):
    """The turn is about the condyles, which glide forward by half a millimetre for each degree of it."""
    end = end_of(INCISOR, f"jaw={{opening_mm={opening_mm}}}")
    assert 1e3 * (INCISOR - end)[2] == pytest.approx(opening_mm, abs=1e-9)
    condyle = end_of(HINGE, f"jaw={{opening_mm={opening_mm}}}")
    glide = 1e3 * (HINGE - condyle)
    arms = [np.degrees(np.arctan2(*(axis - point)[[2, 0]])) for axis, point in ((HINGE, INCISOR), (condyle, end))]
    assert glide[0] == pytest.approx(GLIDE_MM_PER_DEG * (arms[1] - arms[0]), abs=1e-9)
    assert glide[1] == glide[2] == 0.0
    assert np.linalg.norm(condyle - end) == pytest.approx(np.linalg.norm(HINGE - INCISOR), rel=1e-12)


def test_a_degree_is_so_many_millimetres():
    """1.44 mm down and 0.75 mm back for a degree without a glide: models/tongue/SOURCES.md."""
    moved = 1e3 * (end_of(INCISOR, "jaw={opening_deg=1, forward_mm=0}") - INCISOR)
    assert moved == pytest.approx([0.75, 0.0, -1.44], abs=0.015)
    gliding = 1e3 * (end_of(INCISOR, "jaw={opening_deg=1}") - INCISOR)
    assert gliding - moved == pytest.approx([-0.5, 0.0, 0.0], abs=1e-12)
    assert 1e3 * (end_of(INCISOR, "jaw={down_mm=2}") - INCISOR) == pytest.approx([0.0, 0.0, -2.0], abs=1e-12)


def test_what_cannot_be_is_refused():
    with pytest.raises(InputError, match="opening_deg or opening_mm, not both"):
        scenario("jaw={opening_deg=3, opening_mm=5}")
    with pytest.raises(InputError, match=r"jaw\.opening_mm: no rotation opens incisors 2 mm"):
        jaw_motion(scenario("jaw={opening_mm=5, axis_mm=[55.5, 0, 95]}"))
    foreign = scenario("jaw={opening_mm=5, axis_mm=[136, 0, 138]}")
    foreign = foreign.model_copy(update={"model": foreign.model.model_copy(update={"name": None, "file": "own.toml"})})
    with pytest.raises(InputError, match=r"jaw\.incisor_mm is missing"):
        jaw_motion(foreign)


@cache
def opened() -> Model:
    """Styloglossus, the only muscle that begins outside of the tongue, and an open jaw."""
    return assemble(scenario("jaw={opening_mm=5}", "hyoid={}"), ROOT / "scenarios")[0]


def test_all_that_belongs_to_the_jaw_moves_with_it():
    """Surface and ties of the jaw have one motion, palate and hyoid bone none; the latter hangs on 8 springs of 220 N/m."""
    model = opened()
    motions = {bone.name: bone.motion for bone in model.bones}
    ties = {tie.name: tie for tie in model.attachments}
    assert motions["palate"] is None and motions["jaw"] is not None
    assert ties["hyoid"].motion is None and ties["hyoid"].bone_stiffness_N_m == pytest.approx(8 * 220.0)
    assert ties["jaw"].motion is not None and np.isinf(ties["jaw"].bone_stiffness_N_m)
    placements = [motion.placement(np.array([0.02])) for motion in (motions["jaw"], ties["jaw"].motion)]
    for one, other in zip(*placements, strict=True):
        np.testing.assert_array_equal(one, other)


def test_two_muscles_begin_in_space():
    """On the styloid process and in the soft palate, which belong to the skull. All others begin in the tissue, and move with its
    ties."""
    anatomy = catalogue.built_in("tongue", "coarse", None)
    for name, muscle in anatomy.muscles.items():
        in_space = np.concatenate([fibre.points.position[fibre.points.element < 0] for fibre in muscle.fibres])
        if name == "STY":
            np.testing.assert_allclose(1e3 * np.abs(in_space), np.tile([150.0, 36.0, 125.0], (len(muscle.fibres), 1)))
        elif name == "PG":
            assert len(in_space) == len(muscle.fibres) and (in_space[:, 0] > 0.103).all()  # behind the hard palate
        else:
            assert not len(in_space)


def test_a_muscle_anchored_on_a_bone_that_moves_is_refused():
    model = opened()
    check_anchors(model.pulls, model.bones)
    jaw = next(bone for bone in model.bones if bone.name == "jaw")
    shift = INCISOR - model.pulls[0].points[0].position[0]
    moved = [replace(points, position=points.position + shift) for points in model.pulls[0].points]
    with pytest.raises(InputError, match=r"muscle STY is anchored at .* on the bone jaw, which moves"):
        check_anchors([replace(model.pulls[0], points=tuple(moved))], [jaw])
    check_anchors([replace(model.pulls[0], points=tuple(moved))], [replace(jaw, motion=None)])
