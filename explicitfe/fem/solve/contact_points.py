"""Contact of a tool: the contact points of the surface, their penalty springs, and the position of the tool."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from explicitfe.fem.model.model import Model, Tool
from explicitfe.fem.solve.kernels import Kernels
from explicitfe.platform.compiled.arrays import COMPLIANCE, DEPTH, DRIVE, FREE, GOAL, LOAD, PACE, SHAPE, TIED, TILT, TOOL, Contact

# The contact springs begin at this multiple of the shear modulus over the face size, and are doubled while the tool sinks in by
# more than the allowed share of the indentation. Softer ones would only be doubled more often, stiffer ones slow the relaxation.
FIRST_SPRING_RATIO = 4000.0
PENETRATION_SHARE = 1e-3
# Friction is computed with tangential springs, softer than the springs that press by this factor: stiff enough that the surface
# hardly moves before it slides, and soft enough that the fictitious masses need not grow. A bonded tool has the factor 1.
GRIP_SHARE = 0.1
BEYOND_ANY_SPECIMEN_m = 1e3  # the flat radius of a platen, which is infinite, in numbers that a kernel can subtract
HEIGHT_OUT_OF_REACH_m = 1.0  # above the surface, where no tool reaches tissue that sags or swells
MOST_LIFTS = 20  # attempts to lift a tool out of the surface before a load begins: each one leaves at most a few points inside
MISSED_SHARE_OF_LOAD = 1e-2  # by which the springs under a tool may miss its load; elsewhere they meet it within rounding
ITERATIONS_TO_GOAL = 200  # in which a tool whose displacement is imposed gets there: a sudden push would tear elements


class Touch(NamedTuple):
    """What the contact points feel."""

    gap: np.ndarray  # distance from the tool, negative inside it [m], (k,)
    push: np.ndarray  # normal force of the tool, negative where it sticks [N], (k,)
    traction: np.ndarray  # friction force of the tool [N], (k, 3)


class ToolContact:
    """A tool and the points of the surface that it may touch; without a tool there are no points.

    Parameters
    ----------
    model : the physics.
    place : (n,) row of each node in computing order.
    points : (n, 3) m, reference positions of the nodes in computing order.
    kernels : of the body.

    Attributes
    ----------
    points : what the kernels read of the contact points.
    tool : (TOOL,). The tool's state, as in ``compiled/arrays.py``.
    """

    def __init__(self, model: Model, place: np.ndarray, points: np.ndarray, kernels: Kernels) -> None:
        self._kernels = kernels
        tool = model.tool
        self.tool = np.zeros(TOOL)
        shape = np.zeros(SHAPE)
        nodes, weights, areas, facing = np.zeros((0, 4), dtype=np.int64), np.zeros((0, 4)), np.zeros(0), np.zeros(0)
        stiffness = 0.0
        if tool is not None:
            nodes, weights, areas, facing = place[tool.nodes], tool.weights, tool.areas_m2, tool.facing_m2
            stiffness = FIRST_SPRING_RATIO * model.material.shear_modulus_Pa / tool.face_size_m
            shape[:] = _shape_of(tool)
            # only a part of the body is computed, and it carries only its share of the force that bends the rig
            self.tool[COMPLIANCE] = tool.compliance_m_N * model.copies
        grips = 1.0 if shape[TIED] else GRIP_SHARE * (tool is not None and tool.friction > 0.0)
        self.points = Contact(
            node=np.ascontiguousarray(nodes, dtype=np.uint32),
            weight=np.array(weights),
            position=np.einsum("kc,kci->ki", weights, points[nodes]),
            spring=stiffness * areas,
            area=np.array(facing),
            grip=grips * stiffness * areas,
            anchor=np.zeros((len(areas), 3)),
            shape=shape,
            moved=np.zeros((len(areas), 3)),
        )

    @property
    def tied(self) -> bool:
        """Whether the tool is bonded to its points."""
        return bool(self.points.shape[TIED] > 0.0)

    @property
    def tilted(self) -> bool:
        """Whether the tool leans."""
        return bool(self.points.shape[TILT] != 0.0)

    @property
    def depth_m(self) -> float:
        """How far down the tool is, from its height in the model [m]."""
        return float(self.tool[DEPTH])

    def touch(self, u: np.ndarray) -> Touch:
        """Distances and forces of the contact points at displacement rows u."""
        count = len(self.points.spring)
        touch = Touch(np.zeros(count), np.zeros(count), np.zeros((count, 3)))
        self._kernels.touch(u, self.points, self.tool, *touch)
        return touch

    def places(self, u: np.ndarray) -> np.ndarray:
        """Present positions (k, 3) m of the contact points."""
        return self.points.position + self._displacements(u)

    def force(self, u: np.ndarray) -> float:
        """Force of the tool along -z [N], on the part of the body that is computed."""
        return float(self._kernels.press(u, np.zeros_like(u), self.points, self.tool))

    def presses(self, u: np.ndarray) -> bool:
        """Whether a tool under a force exerts it: on a body that is too stiff its way is lost in the rounding of places.

        A bonded tool can also pull; its load is then negative.
        """
        load = self.tool[LOAD]
        return not self.tool[FREE] or load == 0.0 or abs(self.force(u) - load) <= MISSED_SHARE_OF_LOAD * abs(load)

    def driven_m(self, u: np.ndarray) -> float:
        """How far down the tool is, with what the rig gives way by, as a machine reads it [m]."""
        return float(self.tool[DEPTH] + self.tool[COMPLIANCE] * self.force(u))

    # ---- between loads ----

    def retreat(self) -> None:
        """Take the load off the tool: it goes out of reach of the surface or, bonded to it, wherever that goes."""
        depth_m = 0.0 if self.tied else -HEIGHT_OUT_OF_REACH_m
        self.tool[[FREE, LOAD]] = float(self.tied), 0.0
        self.tool[[DEPTH, DRIVE, GOAL]] = depth_m

    def aim(self, u: np.ndarray, goal_m: float, driven_m: float, allowed_m: float) -> None:
        """Set out for a depth from where the surface is hardly pressed: a sudden deep push would tear the elements there.

        Parameters
        ----------
        u : displacement rows.
        goal_m : depth that is aimed at.
        driven_m : where the machine stood at the last equilibrium; a bonded tool, or one in a rig that gives way, starts there.
        allowed_m : how far inside the surface the tool may begin.
        """
        tool = self.tool
        if self.tied or tool[COMPLIANCE] > 0.0:
            tool[DRIVE], tool[GOAL] = driven_m, goal_m
        else:
            tool[[DEPTH, DRIVE, GOAL]] = goal_m
            for _ in range(MOST_LIFTS):
                inside = -self.touch(u).gap.min(initial=0.0)
                if inside <= allowed_m:
                    break
                tool[DEPTH] -= inside
                tool[DRIVE] = tool[DEPTH]
        tool[PACE] = max(abs(tool[GOAL] - tool[DRIVE]), 1e-15) / ITERATIONS_TO_GOAL

    def return_to(self, depth_m: float, driven_m: float) -> None:
        """Put the tool where it was at an equilibrium."""
        self.tool[[DEPTH, DRIVE]] = depth_m, driven_m
        self.tool[PACE] = abs(self.tool[GOAL] - driven_m) / ITERATIONS_TO_GOAL

    def descend_to_first_touch(self, u: np.ndarray) -> None:
        """Go down by the distance to the nearest point, again and again: the tool never gets past a point."""
        gap = self.touch(u).gap.min(initial=np.inf)
        while 1e-15 < gap < np.inf:
            self.tool[DEPTH] += gap
            gap = self.touch(u).gap.min()

    def stiffen(self, u: np.ndarray, indentation_m: float) -> bool:
        """Double the springs where the tool has sunk in by more than its share of an indentation; whether that was needed."""
        if len(self.points.spring) == 0 or -self.touch(u).gap.min(initial=0.0) <= PENETRATION_SHARE * indentation_m:
            return False
        if self.tied:
            return False
        self.points.spring[:] *= 2.0
        self.points.grip[:] *= 2.0
        return True

    def settle_friction(self, u: np.ndarray) -> float:
        """Move the anchors of friction to where they are at this equilibrium; give the energy lost by slipping there [J]."""
        _, push, traction = self.touch(u)
        points = self.points
        place = self._displacements(u)
        place[:, 2] += self.tool[DEPTH]
        if not len(place) or not points.grip.any() or self.tied:
            return 0.0
        # What sticks keeps its elastic slip; what is free begins to slip where it touches next.
        elastic = np.where(push[:, None] > 0.0, -traction / points.grip[:, None], 0.0)
        loss = float(-np.sum(traction * (place - elastic - points.anchor)))
        points.anchor[:] = place - elastic
        return loss

    def _displacements(self, u: np.ndarray) -> np.ndarray:
        return np.einsum("kc,kci->ki", self.points.weight, u[self.points.node, :3])


def _shape_of(tool: Tool) -> tuple[float, ...]:
    """A tool as entries of ``Contact.shape``."""
    return (
        min(tool.flat_radius_m, BEYOND_ANY_SPECIMEN_m),
        tool.edge_radius_m,
        float(tool.wall),
        tool.height_m,
        float(tool.tied),
        tool.friction,
        tool.tilt_rad,
        tool.adhesion_Pa,
        tool.reach_m,
    )
