"""Derivatives of the input arrays of the kernels by a constant or a force, from finite differences of models.

The models at nearby values of a constant are built, and their arrays are compared. What depends linearly on it is differenced
exactly, anything else to fourth order. An array that changes, and whose changes the tangents do not know, is a reason to refuse.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from explicitfe.fem.elements import barrier
from explicitfe.fem.model.model import Model
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.platform.compiled.arrays import zeros
from explicitfe.platform.compiled.simd import WIDTH
from explicitfe.platform.errors import InputError

SHARE_OF_VALUE = 1e-5  # of a value: rounding of 1e-16 / 1e-5, and an error of (1e-5)^4
LINEAR_WITHIN = 1e-9  # curvature relative to the difference of an array that is taken to be linear
_OF_BONES = ("spring", "damper", "mobility", "damping", "distance", "origin", "friction")  # what their force depends on
CENTRAL = "take central differences of two runs with a fixed analysis.step_us instead"


@dataclass(frozen=True)
class Direction:
    """A constant or force by which a run is differentiated.

    Attributes
    ----------
    key : its name, in SI units or those of a scenario.
    value : at which the run is made.
    model_at : the model at another value; it differs from that of the run by the key alone.
    """

    key: str
    value: float
    model_at: Callable[[float], Model]


def inputs_of(simulation: Simulation, directions: Sequence[Direction]) -> dict[str, np.ndarray]:
    """Derivatives of the input arrays of the kernels; the keys are the names of the fields of ``Tangents``.

    Raises
    ------
    InputError : a direction changes what the tangents do not know.
    """
    changes = [_changes(simulation, direction) for direction in directions]
    groups = -(-len(directions) // WIDTH)
    inputs = {}
    for name, value in _smooth(simulation).items():
        if not any(np.any(change[name]) for change in changes):
            inputs[name] = zeros((0, *value.shape[1:], groups, WIDTH))
            continue
        lanes = zeros((*value.shape, groups * WIDTH))
        for lane, change in enumerate(changes):
            lanes[..., lane] = change[name]
        inputs[name] = lanes.reshape(*value.shape, groups, WIDTH)
    inputs["alpha"] = inputs["alpha"].reshape(-1, groups, WIDTH)[:1].reshape(-1, WIDTH)
    return inputs


def _changes(simulation: Simulation, direction: Direction) -> dict[str, np.ndarray]:
    """The derivative of each input by one direction."""
    value = direction.value
    step = SHARE_OF_VALUE * abs(value) or 1e-3
    middle = _smooth(simulation)
    if value == 0.0:  # most constants cannot be negative
        return _forward(simulation, direction, middle, step)
    above, below = (_values_at(simulation, direction, value + sign * step) for sign in (1.0, -1.0))
    first = {name: (above[name] - below[name]) / (2.0 * step) for name in middle}
    if all(_is_small(above[name] + below[name] - 2.0 * middle[name], above[name] - below[name], middle[name]) for name in middle):
        return first
    far_above, far_below = (_values_at(simulation, direction, value + sign * 2.0 * step) for sign in (1.0, -1.0))
    return {name: (4.0 * first[name] - (far_above[name] - far_below[name]) / (4.0 * step)) / 3.0 for name in middle}


def _forward(
    simulation: Simulation, direction: Direction, middle: Mapping[str, np.ndarray], step: float
) -> dict[str, np.ndarray]:
    """The derivative at zero, from one side."""
    near, far = (_values_at(simulation, direction, times * step) for times in (1.0, 2.0))
    return {name: (4.0 * near[name] - 3.0 * middle[name] - far[name]) / (2.0 * step) for name in middle}


def _is_small(curved: np.ndarray, difference: np.ndarray, value: np.ndarray) -> bool:
    """Whether a second difference is nothing but rounding, or small beside the first one."""
    rounding = 8.0 * np.finfo(float).eps * np.max(np.abs(value), initial=0.0)
    return bool(np.max(np.abs(curved), initial=0.0) <= LINEAR_WITHIN * np.max(np.abs(difference), initial=0.0) + rounding)


def _values_at(simulation: Simulation, direction: Direction, value: float) -> dict[str, np.ndarray]:
    """The inputs at another value of the constant; the rest has to be the same."""
    other = Simulation(direction.model_at(value), threads=1)
    known, here = _other_inputs(simulation), _other_inputs(other)
    for name, array in known.items():
        if not (np.shape(array) == np.shape(here[name]) and np.array_equal(array, here[name])):
            raise InputError(f"gradient: {direction.key} changes {name}, whose derivative is not available; {CENTRAL}.")
    if other.model.effects != simulation.model.effects:
        raise InputError(f"gradient: {direction.key} changes the effects of the material; {CENTRAL}.")
    return _smooth(other)


def _smooth(simulation: Simulation) -> dict[str, np.ndarray]:
    """The inputs whose derivatives the tangents know."""
    blocks, loads, count = simulation.blocks, simulation.loads, len(simulation.hexes)
    most = blocks.muscle.shape[1]
    alike = simulation.model.stiffness is None and not simulation.model.inclusions
    modulus = _of_elements(blocks.barrier, count)[:, barrier.MODULUS : barrier.MODULUS + 1]
    inverse = simulation.nodes.inverse_mass.max(axis=1)
    return {
        "constants": _of_elements(blocks.constants, 1 if alike else count),
        "modulus": np.log(np.maximum(modulus, np.finfo(float).tiny)).reshape(-1),
        "sigma": _of_elements(blocks.contraction, count).reshape(count, most, 4)[:, :, 0],
        "dead": loads.dead.force,
        "tension": loads.fibres.tension,
        "log_inverse_mass": np.log(np.where(inverse > 0.0, inverse, 1.0)),
        "alpha": np.array([simulation.alpha_per_s]),
    }


def _of_elements(blocks: np.ndarray, count: int) -> np.ndarray:
    """(B, k, W) blocks as (m, k) of elements."""
    return blocks.transpose(0, 2, 1).reshape(len(blocks) * WIDTH, blocks.shape[1])[:count]


def _other_inputs(simulation: Simulation) -> dict[str, np.ndarray]:
    """What a direction must not change, by what a message calls it."""
    blocks, loads, bones, ties = simulation.blocks, simulation.loads, simulation.bones, simulation.ties
    most = blocks.muscle.shape[1]
    fibres = _of_elements(blocks.contraction, len(simulation.hexes)).reshape(len(simulation.hexes), most, 4)[:, :, 1:]
    courses = [*loads._profiles, *loads._muscles]
    return {
        "the mesh": simulation.points,
        "the elements": simulation.hexes,
        "which nodes are held": simulation.nodes.inverse_mass == 0.0,
        "the initial displacement": simulation.state.u,
        "which muscles pull where": blocks.muscle,
        "the directions of muscles": fibres,
        "how muscles shorten": blocks.activation[:, 1],
        "how the material changes in elements": np.array(len(blocks.constants)),
        "hourglass control": blocks.hourglass,
        "where loads act": np.concatenate([loads.dead.node, loads.dead.start, loads.dead.profile]),
        "follower fibres": np.concatenate([loads.fibres.position.ravel(), loads.fibres.weights.ravel()]),
        "follower forces": loads.turning.force,
        "hanging weights": loads.weights.weight,
        "drag": np.concatenate([loads.drag.linear.ravel(), loads.drag.quadratic.ravel()]),
        "the course of a load": np.concatenate([np.zeros(0), *(c.time_s for c in courses), *(c.scale for c in courses)]),
        "contact with bones": np.concatenate(
            [
                np.ravel(getattr(bones, name))
                for name in ("spring", "damper", "mobility", "damping", "distance", "origin", "friction")
            ]
        ),
        "the motion of bones": loads.bones(np.linspace(0.0, 1.0, 11))[0],
        "ties to bones": np.concatenate([ties.stiffness, ties.bone_stiffness, ties.excess]),
        "the motion of bones that hold the body": loads.bones(np.linspace(0.0, 1.0, 11))[1],
    }
