"""Steps of a run with the tangents of its state: the derivative of solve/step.py, at the steps that the run itself takes.

The state of a run after a step is a function of that before and of the inputs; what is computed here is its derivative along
directions of the inputs, of the program as it stands and not of the equations that it approximates. The time step is given.
"""

from __future__ import annotations

from typing import Any

from explicitfe.fem.tangent.arrays import COMPONENTS
from explicitfe.fem.tangent.bone import add_bone_changes
from explicitfe.fem.tangent.loads import add_dead_changes, add_fibre_changes, add_tie_changes
from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.simd import WIDTH, load, splat, store
from explicitfe.platform.compiled.threads import asked_to_stop

# Placeholders, bound in solve/differentiated.py: the step and the changes of the internal forces.
plain_advance: Any = None
internal_change: Any = None


def advance(state, part, shared, actions, dt_before, dt, ceilings, first, last, ledger):
    """``step.advance`` with the tangents; of one part."""
    tangents = shared.tangents
    done = first
    for step in range(first, last):
        h = 0.5 * (dt_before + dt)
        half = 1.0 + 0.5 * shared.alpha * h
        keep, gain = (1.0 - 0.5 * shared.alpha * h) / half, h / half
        keep_change, gain_change = -h / (half * half), -0.5 * h / half
        add_changes(state, shared, actions, step, tangents)
        add_bone_changes(state, actions, step, gain, gain_change, tangents)
        for at in range(0, tangents.before.size, WIDTH):
            store(tangents.before, at, load(state.v, at))
        done = plain_advance(state, part, shared, actions, dt_before, dt, ceilings, step, step + 1, ledger)
        move(state, shared.nodes, keep, gain, dt, keep_change, gain_change, tangents)
        internal_change(state.u, part.blocks, tangents)
        dt_before = dt
        if asked_to_stop(part.gate):
            break
    return done


@leaf
def add_changes(state, shared, actions, instant, tangents):
    """Add the changes of the external forces to those of the internal ones."""
    add_dead_changes(actions.dead, actions.activation, instant, tangents)
    add_fibre_changes(state.u, actions.fibres, actions.activation, instant, tangents)
    add_tie_changes(actions.ties, tangents)


@leaf
def move(state, nodes, keep, gain, dt, keep_change, gain_change, tangents):
    """Change velocities and displacements: the derivative of v+ = keep v- + gain f / m and of u+ = u + dt v+.

    gain f / m is taken from the step that has been made: v+ - keep v-.
    """
    rows = tangents.u.shape[1]
    damped, heavier = len(tangents.alpha) > 0, len(tangents.log_inverse_mass) > 0
    groups = len(tangents.u)
    for group in range(groups):
        dalpha = splat(0.0)
        if damped:
            dalpha = load(tangents.alpha, group * WIDTH)
        for node in range(rows):
            for k in range(3):
                at = ((group * rows + node) * COMPONENTS + k) * WIDTH
                new = keep * load(tangents.v, at) + (gain * nodes.inverse_mass[node, k]) * load(tangents.force, at)
                if damped or heavier:
                    old = tangents.before[node, k]
                    pushed = state.v[node, k] - keep * old
                    new = new + (keep_change * old + gain_change * pushed) * dalpha
                    if heavier:
                        new = new + pushed * load(tangents.log_inverse_mass, (node * groups + group) * WIDTH)
                store(tangents.v, at, new)
                store(tangents.u, at, load(tangents.u, at) + dt * new)


def begin(state, blocks, shared, actions, dt):
    """Half-step start of the tangents of a body at rest that touches no bone: dv = -dt/2 d(f / m)."""
    tangents = shared.tangents
    internal_change(state.u, blocks, tangents)
    for at in range(0, tangents.force.size, WIDTH):
        store(tangents.v, at, load(tangents.force, at))  # kept: the changes of the internal forces at the first instant
    add_changes(state, shared, actions, 0, tangents)
    rows = tangents.u.shape[1]
    groups = len(tangents.u)
    for group in range(groups):
        for node in range(rows):
            for k in range(3):
                at = ((group * rows + node) * COMPONENTS + k) * WIDTH
                internal, change = load(tangents.v, at), load(tangents.force, at)
                store(tangents.force, at, internal)
                new = (-0.5 * dt * shared.nodes.inverse_mass[node, k]) * change
                if len(tangents.log_inverse_mass) > 0:  # v_(-1/2) = -dt/2 f / m
                    new = new + state.v[node, k] * load(tangents.log_inverse_mass, (node * groups + group) * WIDTH)
                store(tangents.v, at, new)
