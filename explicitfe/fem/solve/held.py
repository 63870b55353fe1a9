"""The equilibrium of a body of which some nodes are held displaced, as the initial state of a run.

The body moves under its loads and is damped critically for the slowest mode that moves, whose frequency follows from Rayleigh's
quotient of the last steps (adaptive dynamic relaxation, Underwood 1983). So every force of a run in time is possible.
History-dependent materials are taken as relaxed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from explicitfe.fem.model.model import Model, PrescribedMotion
from explicitfe.fem.model.profile import Profile
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import TURNS_AT_THE_START
from explicitfe.platform.errors import InputError
from explicitfe.platform.host import stopping

# Unbalanced forces relative to the forces that hold and load the body, at which the shape is found.
RESIDUAL = 1e-4
# Steps between two estimates of the slowest mode, and the largest number of these.
STEPS_PER_CHECK, MOST_CHECKS = 40, 10_000
SETTLING_STEP_SHARE = 0.6  # of the stable limit
LARGEST_DAMPING_SHARE = 0.2  # mass-proportional damping times the step


def held_shape(model: Model, nodes: np.ndarray, shift_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacement of the body, and the forces that hold it.

    Parameters
    ----------
    nodes : (k,) held nodes.
    shift_m : (3,) their displacement, m.

    Returns
    -------
    (n, 3) m; (k, 3) N, on the held nodes.

    Raises
    ------
    InputError : no equilibrium is found.
    """
    free = nodes[~model.held[nodes].all(axis=1)]
    target = np.broadcast_to(shift_m, (len(free), 3))
    motion = PrescribedMotion(free, lambda times: np.broadcast_to(target, (len(times), *target.shape)).copy())
    start = np.zeros((model.mesh.node_count, 3))
    start[free] = shift_m
    simulation = Simulation(_long_term_model(replace(model, motion=motion, alpha_per_s=0.0)), displacement=start, threads=1)
    step_s = SETTLING_STEP_SHARE * simulation.stable_limit(TURNS_AT_THE_START)
    simulation.start(step_s)
    held = model.held | np.isin(np.arange(model.mesh.node_count), free)[:, None]
    mass = simulation.nodal_mass[:, None]
    before, force_before = simulation.displacement.copy(), simulation.internal_force(simulation.displacement)
    for _ in range(MOST_CHECKS):
        if not simulation.advance(STEPS_PER_CHECK, step_s):
            break
        stopping.check()
        now = simulation.displacement.copy()
        internal, external = simulation.internal_force(now), simulation.external_force()
        unbalanced = np.linalg.norm((external - internal)[~held])
        if unbalanced <= RESIDUAL * max(np.linalg.norm(external), np.linalg.norm(internal[held])):
            force = np.zeros((model.mesh.node_count, 3))
            force[free] = (internal - external)[free]
            return now, force[nodes]
        moved = np.where(held, 0.0, now - before)
        stiffness = float(np.sum(moved * (internal - force_before)) / max(float(np.sum(mass * moved**2)), 1e-300))
        damping = float(min(2.0 * np.sqrt(max(stiffness, 0.0)), LARGEST_DAMPING_SHARE / step_s))
        simulation.alpha_per_s = damping
        before, force_before = now, internal
    raise InputError("release.hold: no equilibrium is found with the held nodes; reduce release.shift_mm.")


def _long_term_model(model: Model) -> Model:
    """A model with its long-term elasticity in place of its history-dependent effects, under its initial loads."""
    share = float(np.prod([effect.long_term_share for effect in model.effects]))

    def now(profile: Profile) -> Profile:
        return Profile(np.zeros(1), profile.at(np.zeros(1), tolerance_s=0.0))

    loads = {
        name: tuple(replace(load, profile=now(load.profile)) for load in getattr(model, name))
        for name in ("loads", "followers", "pressures", "weights", "pulls", "stresses")
    }
    stiffness = np.full(model.mesh.element_count, share) if model.stiffness is None else share * model.stiffness
    kept = tuple(effect for effect in model.effects if not effect.remembers)
    return replace(model, effects=kept, stiffness=stiffness if share != 1.0 else model.stiffness, **loads)  # type: ignore[arg-type]
