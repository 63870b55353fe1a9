"""A specimen under a tool with one degree of freedom: its deformation is one of those that an elastic body takes on a ramp.

The elastic states of one coarse run are a curve in the space of all deformations, with the depth of the tool as its parameter. A
material with a memory follows its own path at every element, while the body is kept on this curve; by virtual work its stress
gives the force of the tool. The force at a given depth is then exact to first order in what the material differs from the elastic
one (Ritz's method), and a test costs milliseconds. Answers are compared with each other, so that errors of the mesh cancel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from explicitfe.fem.effects import Effect, physics_of, readings_of
from explicitfe.fem.effects.effect import MaterialEffect, with_leaves
from explicitfe.fem.inputs.specimen import ToolTable
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import ritz
from explicitfe.fem.solve.load_outcome import Stuck
from explicitfe.fem.solve.revolution import Revolution
from explicitfe.fem.solve.ritz import Family
from explicitfe.inverse.measured.course import Course
from explicitfe.inverse.measured.curve import Curve
from explicitfe.inverse.predict.reading import reading
from explicitfe.inverse.predict.setup import setup_of
from explicitfe.inverse.predict.tissue import Numerics
from explicitfe.inverse.predict.under_a_tool import as_cylinder, course_of_test

# States of the ramp.
RAMP_STATES = 33
# Powers of the depth in the deformation gradients. Contact begins at single nodes, which makes a run ripple; the smooth part of
# it is what is needed. A round tool touches a circle that grows with the root of the depth.
FLAT_TOOL_POWERS = (1.0, 2.0, 3.0, 4.0, 5.0)
SPHERE_POWERS = (0.5, 1.0, 1.5, 2.0, 3.0)
# The ramp goes beyond the largest depth that was measured, for models that are softer.
DEPTH_MARGIN = 1.25
# A body that keeps its volume does no work in the change of volume, which is left out of virtual work: it would be a small
# difference of large numbers.
POINT_POISSON_RATIO = 0.3
# Divides the element sizes of the body.
REDUCED_FINENESS = 0.4


@dataclass(frozen=True, eq=False)
class ReducedSpecimen:
    """The elastic states of a specimen under a tool.

    Attributes
    ----------
    ends_m : smallest and largest depth of the tool.
    family : of deformations, by the share of the largest depth.
    tied : the tool can pull.
    """

    ends_m: tuple[float, float]
    family: Family
    tied: bool

    def follow(self, law: Yeoh, effects: Sequence[MaterialEffect], course: Course, by_force: bool) -> np.ndarray:
        """Force or depth (n,) at the instants of a course; a tool that cannot pull leaves the body.

        Raises
        ------
        RunError : a state has no finite stress.
        """
        law = law.model_copy(update={"poisson": POINT_POISSON_RATIO})
        largest = self.ends_m[1]
        kind = ritz.BY_FORCE if by_force else ritz.TIED if self.tied else ritz.BY_DEPTH
        imposed = course.imposed if by_force else course.imposed / largest
        share, force = self.family.follow(law, effects, course.time_s, imposed, kind)
        return largest * share if by_force else force

    def answers(self, test: Sequence[Curve], law: Yeoh, effects: Sequence[Effect], density: float) -> list[np.ndarray]:
        """What the curves of a test measure, SI."""
        by_force = test[0].imposed == "force_N"
        course, time_s, _, contact_power = course_of_test(test, effects, density)
        for effect in effects:
            law = effect.in_law(law)
        values = course.at(self.follow(law, with_leaves(physics_of(effects)), course, by_force), time_s, contact_power)
        parts = np.split(values, np.cumsum([len(curve.time_s) for curve in test])[:-1])
        return reading(parts, test, readings_of(effects), by_force)


def reduced_specimen(alike: Sequence[Curve], law: Yeoh, numerics: Numerics) -> ReducedSpecimen | None:
    """The elastic states of a specimen, down to the largest depth of some tests that differ in their course only; None where they
    cannot be computed."""
    curve = alike[0]
    assert curve.tool is not None
    tied = curve.tool.shape == "bonded-disc"
    setup = setup_of(curve, law.poisson, numerics.refinement)
    measured = np.concatenate([one.displacement_m for one in alike])
    largest = DEPTH_MARGIN * float(measured.max())
    least = DEPTH_MARGIN * min(float(measured.min()), 0.0) if tied else 0.0
    shares, states, forces = [], [], []
    for end in (largest, least):
        if end == 0.0:
            continue
        body = Revolution(as_cylinder(setup.specimen, law), ToolTable.model_validate(setup.tool), law, fineness=REDUCED_FINENESS)
        weights = body.section.quads.weights
        if isinstance(body.settle(), Stuck):
            return None
        for part in np.arange(1, RAMP_STATES) / (RAMP_STATES - 1):
            reached = body.move(float(part * end), at_s=0.0)
            if isinstance(reached, Stuck):
                break
            shares.append(float(part * end) / largest)
            states.append(_means(body.gradients, weights))
            forces.append(reached.force_N)
        volumes = weights.sum(axis=1)
    if len(shares) < RAMP_STATES // 2:
        return None
    powers = SPHERE_POWERS if curve.tool.shape == "sphere" else FLAT_TOOL_POWERS
    family = Family.fitted(np.array(shares), np.array(states), volumes / largest, powers)
    light = law.model_copy(update={"poisson": POINT_POISSON_RATIO})
    _, work = family.follow(light, (), np.zeros(len(shares)), np.array(shares), ritz.TIED)
    factor = float(work @ forces / (work @ work))
    ends = (min(0.0, *shares), max(shares))
    return ReducedSpecimen((ends[0] * largest, ends[1] * largest), family.scaled(factor, ends), tied)


def _means(columns: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Means (m, 9) over elements of columns (m q, 9) at their points with weights (m, q)."""
    return np.einsum("mqi,mq->mi", columns.reshape(*weights.shape, -1), weights) / weights.sum(axis=1)[:, None]
