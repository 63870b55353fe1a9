"""A body with one degree of freedom: its points follow a given family of deformations, and virtual work gives the force.

The deformation gradient of each point is 1 + sum of mode x share ** power, with the share of the largest depth as the parameter.
At each instant the parameter is found for a force, or the force for a depth; between instants the material remembers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from explicitfe.fem.effects.complete import complete
from explicitfe.fem.effects.effect import MaterialEffect
from explicitfe.fem.effects.material.nonlinear_relaxation import NonlinearSeries
from explicitfe.fem.forces import response
from explicitfe.fem.materials import Law, law_of
from explicitfe.fem.materials.kinematics import cofactor, determinant
from explicitfe.fem.solve.point import blocks_at_rest, numbers_along
from explicitfe.platform.compiled.jit import Dispatcher, bind, leaf
from explicitfe.platform.compiled.simd import WIDTH, load_many, splat, store
from explicitfe.platform.errors import RunError

# Placeholders, bound below.
respond: Any = None
LAW_CONSTANTS = 1
MOST_TURNS = 60
# A share is found to this accuracy, or the force to this part of the largest one that is imposed.
SHARE_TOLERANCE, FORCE_TOLERANCE = 1e-10, 1e-7
# The derivative of a root is taken no nearer to zero than at this share.
SMALLEST_RITZ_SHARE = 1e-3
# The first step to either side, as a share.
FIRST_STEP = 0.02
NEAR_TURNS = 3
BY_FORCE, BY_DEPTH, TIED = 0, 1, 2  # kinds of tools: one that presses with a force, one that is moved, one that is glued


@leaf
def power_of(share: float, power: float) -> float:
    """A power of a share; odd for negative ones where it is no integer."""
    if power == np.floor(power):
        return share**power
    return np.sign(share) * abs(share) ** power


@leaf
def slope_of(share: float, power: float) -> float:
    """Its derivative."""
    if power == np.floor(power):
        return power * share ** (power - 1.0)
    return power * max(abs(share), SMALLEST_RITZ_SHARE) ** (power - 1.0)


def follow(imposed, kind, ends, powers, modes, volumes, numbers, blocks, states, columns, answers):
    """Find the answers at all instants; give the number of instants done.

    Parameters
    ----------
    imposed : (n,) forces, or shares of the largest depth.
    kind : BY_FORCE, BY_DEPTH or TIED.
    ends : smallest and largest share.
    powers, modes, volumes : (k,), (k * blocks, 9, W) and (blocks, W) of the family; force = sum of volume x P : dF / d share.
    numbers : of the effects at the instants.
    states, columns : (2 * blocks, 9, W) and (2, k) work arrays.
    answers : (n, 2) receives the share and the force.
    """
    count = len(volumes)
    share = 0.0
    largest = 0.0
    for goal in imposed:
        largest = max(largest, abs(goal))
    tolerance = FORCE_TOLERANCE * largest
    for k in range(len(numbers.steady)):
        blocks.effects[:, k] = numbers.steady[k]
    for instant in range(len(imposed)):
        for k in range(len(numbers.places)):
            blocks.effects[:, numbers.places[k]] = numbers.moving[instant, k]
        goal = imposed[instant]
        low, high = ends[0], ends[1]
        below, above, side = -np.inf, np.inf, 0
        searches = kind == BY_FORCE
        if not searches:
            share = min(max(goal, low), high)
        force = 0.0
        for turn in range(MOST_TURNS):
            force = 0.0
            for j in range(len(powers)):
                columns[0, j], columns[1, j] = power_of(share, powers[j]), slope_of(share, powers[j])
            for block in range(count):
                for k in range(9):
                    for lane in range(WIDTH):
                        F, slope = (1.0 if k % 4 == 0 else 0.0), 0.0
                        for j in range(len(powers)):
                            mode = modes[j * count + block, k, lane]
                            F += mode * columns[0, j]
                            slope += mode * columns[1, j]
                        states[block, k, lane] = F
                        states[count + block, k, lane] = slope
            for block in range(count):
                deformation = load_many(states, block * 9 * WIDTH, 9)
                cof = cofactor(deformation)
                c = load_many(blocks.constants, block * (LAW_CONSTANTS * WIDTH), LAW_CONSTANTS)
                P, _ = respond(deformation, cof, determinant(deformation, cof), splat(0.0), c, blocks, block)
                for k in range(9):
                    store(states, (block * 9 + k) * WIDTH, P[k])
                for lane in range(WIDTH):
                    work = 0.0
                    for k in range(9):
                        work += states[block, k, lane] * states[count + block, k, lane]
                    force += volumes[block, lane] * work
            if not np.isfinite(force):
                return instant
            if not searches:
                if kind == TIED or force >= 0.0:
                    break
                searches, goal, low = True, 0.0, share  # the tool has left the body, which comes to rest without force
            # Regula falsi with the Illinois weights (Dowell & Jarratt 1971), which a kink of the response cannot mislead.
            wrong = force - goal
            if wrong < 0.0:
                low, below = share, wrong
                above = 0.5 * above if side < 0 else above
                side = -1
            else:
                high, above = share, wrong
                below = 0.5 * below if side > 0 else below
                side = 1
            if high - low <= SHARE_TOLERANCE or abs(wrong) <= tolerance:
                break
            if np.isfinite(below) and np.isfinite(above):
                share = low - below * (high - low) / (above - below)
            elif turn < NEAR_TURNS:
                step = FIRST_STEP * 4.0**turn
                share = min(share + step, high) if wrong < 0.0 else max(share - step, low)
            else:
                share = 0.5 * (low + high)
        answers[instant, 0] = share
        answers[instant, 1] = 0.0 if searches and kind != BY_FORCE else force
        for block in range(count):
            for k in range(blocks.old.shape[1]):
                for lane in range(WIDTH):
                    blocks.old[block, k, lane] = blocks.new[block, k, lane]
    return len(imposed)


@cache
def _kernel(law: str, layout: response.Layout) -> Dispatcher:
    leaves = law_of(law)
    answer, _ = response.bound(leaves, layout)
    return bind(follow, respond=answer, LAW_CONSTANTS=leaves.count)


@dataclass(frozen=True, eq=False)
class Family:
    """A family of deformations of a body.

    Attributes
    ----------
    powers : (k,) of the share.
    modes : (k, blocks, 9, W) of each point, in lanes.
    volumes : (blocks, W) weights of the points in virtual work, volume over the depth at a share of 1.
    ends : smallest and largest share.
    """

    powers: np.ndarray
    modes: np.ndarray
    volumes: np.ndarray
    ends: tuple[float, float]

    @classmethod
    def fitted(cls, shares: np.ndarray, gradients: np.ndarray, volumes: np.ndarray, powers: Sequence[float]) -> Family:
        """The family that comes nearest to displacement gradients (n, p, 9) at shares (n,)."""
        columns = np.array([[power_of.py_func(float(x), power) for power in powers] for x in shares])
        flat = np.linalg.lstsq(columns, gradients.reshape(len(shares), -1), rcond=None)[0]
        modes = np.array([_in_lanes(mode) for mode in flat.reshape(len(powers), -1, 9)])
        volumes = _in_lanes(volumes[:, None])[:, 0]
        return cls(np.array(powers), modes, volumes, (float(min(shares.min(), 0.0)), float(shares.max())))

    def scaled(self, factor: float, ends: tuple[float, float]) -> Family:
        """With all forces multiplied, and other ends."""
        return replace(self, volumes=factor * self.volumes, ends=ends)

    def follow(
        self, law: Law, effects: Sequence[MaterialEffect], time_s: np.ndarray, imposed: np.ndarray, kind: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Shares and forces (n,) at the instants; see :func:`follow`.

        Raises
        ------
        RunError : a state has no finite stress.
        """
        effects = complete(effects or [NonlinearSeries()])
        answers, increments = np.zeros((len(imposed), 2)), np.diff(time_s, prepend=time_s[0])
        done = _kernel(law.law, response.layout_of(effects))(
            np.ascontiguousarray(imposed, dtype=float),
            kind,
            np.array(self.ends),
            self.powers,
            self.modes.reshape(-1, 9, WIDTH),
            self.volumes,
            numbers_along(effects, increments),
            blocks_at_rest(law, effects, self.volumes.size),
            np.zeros((2 * len(self.volumes), 9, WIDTH)),
            np.zeros((2, len(self.powers))),
            answers,
        )
        if done < len(imposed):
            raise RunError(f"the stress is not finite at {time_s[done]:g} s.")
        return answers[:, 0], answers[:, 1]


def _in_lanes(points: np.ndarray) -> np.ndarray:
    """Values (p, m) of points in blocks of lanes (blocks, m, W), zeros in the rest of the last one."""
    count = -(-len(points) // WIDTH)
    filled = np.zeros((count * WIDTH, points.shape[1]))
    filled[: len(points)] = points
    return np.ascontiguousarray(filled.reshape(count, WIDTH, -1).transpose(0, 2, 1))
