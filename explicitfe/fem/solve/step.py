"""The central-difference loop, compiled whole: python never runs per step.

The state holds u at t_n, v at t_(n-1/2) and minus the internal force at t_n. One step solves

    M (v+ - v-) / h + alpha M (v+ + v-) / 2 = f_ext - f_int,   h = (dt- + dt+) / 2,   u <- u + dt+ v+

and evaluates the new internal force. With T = 1/2 v- M v+ the change of T over a step is, exactly, the trapezoidal work of
all forces, so the ledger sums those of the external and of the damping force and leaves nothing to chance (Hughes 2000,
section 9.1; Belytschko et al. 2014, section 6.2.3 averages velocities instead, which is far off in the highest modes).
"""

from __future__ import annotations

import math
from typing import Any

from explicitfe.fem.forces.apart import surfaces_loss
from explicitfe.fem.forces.bone import bones_loss, fastest_bone, rest_on_bones
from explicitfe.fem.forces.contraction import contraction_work
from explicitfe.fem.forces.weights import move_weights, pull_weights
from explicitfe.fem.solve.boundary import correct, drive, place
from explicitfe.platform.compiled.arrays import (
    CONTACT_LOSS,
    CORNER,
    DAMPING_LOSS,
    EXTERNAL_WORK,
    FALL,
    SMALLEST_CORNER,
    SMALLEST_J,
    STIFFEST,
    SWEEP_ROWS,
    Recurrence,
)
from explicitfe.platform.compiled.contact_arrays import FARTHEST, SPEED
from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.pieces import call_at
from explicitfe.platform.compiled.simd import ROW, WIDTH, load, load_fourth, splat, store, sum_lanes
from explicitfe.platform.compiled.simd_lookup import absolute, larger
from explicitfe.platform.compiled.threads import ask_to_stop, asked_to_stop, wait

# Placeholder, bound in solve/kernels.py.
add_forces: Any = None


def forces(force_at, u, force, blocks):
    """Minus the internal force at displacement u into ``force``; give the smallest J."""
    force[:] = 0.0
    return call_at(force_at, (u, force, blocks))


def advance(state, part, shared, actions, dt_before, dt, ceilings, first, last, ledger):
    """Advance a part of the state from instant ``first`` to ``last`` by steps of length dt; give the instant where it ended.

    The threads of all parts call this at the same time, and meet twice a step: when all internal forces are there, and when
    all nodes have moved. One part is the whole, and meets nobody.

    Parameters
    ----------
    state : State, changed in place.
    part, shared, actions : Part, Shared, Actions.
    dt_before : s. The step that led to the first instant; it differs from dt where the step has just been changed.
    ceilings : Ceilings.
    ledger : (LEDGER,). Sums of work [J], the smallest J and the smallest corner of this part, changed in place.

    The loop ends early, after the step in which an element has turned inside out (J <= 0 or not a number) or has folded at a
    corner, or in which a ceiling has been passed. Prescribed motion is for one part only.
    """
    u, v, whole = state
    nodes, external, alpha = shared.nodes, shared.external, shared.alpha
    motion, muscles = actions.motion, actions.muscles
    bones, placement = actions.bones, actions.bone_placement
    force, shift, own = part.force, part.first * ROW, part.own * ROW
    near, far = bones.begin[part.number], bones.begin[part.number + 1]
    if part.parts > 1:
        for here in range(0, own, WIDTH):
            store(force, here, load(whole, here + shift))
        force[part.own :] = 0.0
    if part.number == 0:
        external[:] = 0.0
    done = last
    nearest = part.blocks.corner[CORNER]
    for step in range(first, last):
        h = 0.5 * (dt_before + dt)
        keep = (1.0 - 0.5 * alpha * h) / (1.0 + 0.5 * alpha * h)
        gain = h / (1.0 + 0.5 * alpha * h)
        driven_work, driven_loss = 0.0, 0.0
        recurrence = Recurrence(keep, gain, 0.5 * dt, 0.5 * dt_before)
        # what these add to the rows of the next part gets there with its elements' forces
        range_of = near, far, bones.travel[part.number, 0]
        rubbed_before, bone_work, _, touching, stiffening = rest_on_bones(
            force, bones.own_rows, u, v, bones, placement, step, range_of, recurrence, shared.unrecorded
        )
        if part.number == 0:
            add_forces(external, u, v, actions, nodes, step, gain)
            driven_work, driven_loss = drive(u, v, force, nodes, motion, actions.planned, step, h, alpha, dt_before, dt)
        wait(part.gate, part.parts)
        if part.parts > 1 and asked_to_stop(part.gate):
            done = step
            break
        for here in range(0, part.lower.size, WIDTH):
            store(force, here, load(force, here) + load(part.lower, here))
        # a model with weights has one part, which has all forces
        pull_weights(external, force, u, v, nodes.update, actions.weights, actions.activation, step, keep, gain, h, dt)
        move_weights(actions.weights, h, dt)
        work = splat(0.0)
        loss = splat(0.0)
        fastest = splat(0.0)
        for run in range(len(part.loaded)):
            begin, end = run * (SWEEP_ROWS * ROW), min((run + 1) * (SWEEP_ROWS * ROW), own)
            if part.loaded[run]:
                for here in range(begin, end, WIDTH):
                    at = here + shift
                    old, push, mass = load(v, at), load(external, at), load_fourth(nodes.update, at)
                    new = keep * old + gain * load(nodes.update, at) * (load(force, here) + push)
                    fastest = larger(absolute(new), fastest)
                    store(v, at, new)
                    store(u, at, load(u, at) + dt * new)
                    store(force, here, splat(0.0))
                    store(external, at, splat(0.0))
                    moved = 0.5 * (dt_before * old + dt * new)
                    work = work + push * moved
                    loss = loss + mass * (old + new) * moved
            else:  # the same without external forces: half of what a step of a large mesh moves is moved here
                for here in range(begin, end, WIDTH):
                    at = here + shift
                    old, mass = load(v, at), load_fourth(nodes.update, at)
                    new = keep * old + gain * load(nodes.update, at) * load(force, here)
                    fastest = larger(absolute(new), fastest)
                    store(v, at, new)
                    store(u, at, load(u, at) + dt * new)
                    store(force, here, splat(0.0))
                    loss = loss + mass * (old + new) * (0.5 * (dt_before * old + dt * new))
        driven_speed = place(u, v, motion, actions.planned, step)
        # a lane has one component of all rows, or two
        bones.speeds[part.number, 0] = math.sqrt(max(1, ROW // WIDTH) * sum_lanes(fastest * fastest) + 3.0 * driven_speed**2)
        if part.number == 0:
            for muscle in range(muscles.shape[1]):
                part.blocks.activation[muscle, 0] = muscles[step + 1, muscle]
        ledger[EXTERNAL_WORK] += sum_lanes(work) + driven_work + bone_work
        ledger[DAMPING_LOSS] += 0.5 * alpha * (sum_lanes(loss) + driven_loss)
        behind = 0.5 * dt_before
        dt_before = dt
        wait(part.gate, part.parts)
        ledger[CONTACT_LOSS] += rubbed_before + bones_loss(bones, near, touching, v, 0.5 * dt)
        fastest_at = max(fastest_bone(bones, placement, step), fastest_bone(bones, placement, step + 1))
        bones.travel[part.number, 0] += dt * (fastest_of(bones.speeds) + fastest_at)
        if part.number == 0:  # their pull is among the external forces, whose work it has lowered
            rubbed = surfaces_loss(actions.surfaces, v, behind, 0.5 * dt)
            ledger[EXTERNAL_WORK] += rubbed
            ledger[CONTACT_LOSS] += rubbed
        force[part.own :] = 0.0
        smallest = call_at(shared.addresses.internal_force, (part.u, force, part.blocks))
        ledger[EXTERNAL_WORK] += contraction_work(part.blocks, muscles[step], muscles[step + 1])
        corner = part.blocks.corner[CORNER]
        fall = nearest - corner
        nearest = corner
        part.blocks.corner[FALL] = fall
        if not (smallest >= ledger[SMALLEST_J]):
            ledger[SMALLEST_J] = smallest
        if not (corner >= ledger[SMALLEST_CORNER]):
            ledger[SMALLEST_CORNER] = corner
        sound = smallest > 0.0 and corner > 0.0
        # the first part writes the speed, and may already be in the next step where another one would read it
        slow = part.number > 0 or dt * actions.surfaces.numbers[SPEED] <= actions.surfaces.numbers[FARTHEST]
        calm = part.blocks.corner[STIFFEST] <= ceilings.barrier and stiffening <= ceilings.contact
        if not (sound and slow and calm and fall <= ceilings.fall * corner):
            ask_to_stop(part.gate)
            if part.parts == 1:
                done = step + 1
                break
    if part.parts > 1:
        wait(part.gate, part.parts)
        for here in range(0, part.lower.size, WIDTH):
            store(force, here, load(force, here) + load(part.lower, here))
        for here in range(0, own, WIDTH):
            store(whole, here + shift, load(force, here))
    return done


@leaf
def fastest_of(speeds):
    """The largest speed of all parts [m/s]; NaN if one is."""
    fastest = speeds[0, 0]
    for part in range(1, len(speeds)):
        if not speeds[part, 0] <= fastest:
            fastest = speeds[part, 0]
    return fastest


def snapshot(state, shared, actions, instant, dt, ledger, rows, record, lanes, energies):
    """Write the energies (ENERGIES,) [J] at an instant, that of the state, and what is recorded there; the state is only read.

    ``rows`` (2, N, 4) receive the velocity at t_n, (v- + v+) / 2, and all forces but the external ones, ``record`` what the bones
    do, and ``lanes`` (3, B, W) J, the strain energy and the hourglass energy [J] of the elements. The actions have one instant
    more than those of ``advance``; dt is the step before. What ties store and what contact between
    surfaces stores and loses counts as external work too, because their forces are among the external ones.
    """
    u, v, force = state
    nodes, external, alpha = shared.nodes, shared.external, shared.alpha
    velocity, resting = rows[0], rows[1]
    bones, placement = actions.bones, actions.bone_placement
    keep = (1.0 - 0.5 * alpha * dt) / (1.0 + 0.5 * alpha * dt)
    gain = dt / (1.0 + 0.5 * alpha * dt)
    external[:] = 0.0
    tied, pressed = add_forces(external, u, v, actions, nodes, instant, gain)
    rubbed = surfaces_loss(actions.surfaces, v, 0.5 * dt, 0.0)
    for at in range(0, u.size, WIDTH):
        store(resting, at, load(force, at))
    record.sums[:] = 0.0
    record.pressure[:] = 0.0
    recurrence = Recurrence(keep, gain, 0.0, 0.5 * dt)
    first = 0 * instant  # a literal 0 would have a type of its own and compile the function again
    range_of = first, len(bones.rows), bones.travel[first, 0]
    friction_loss, bone_work, touching, _, _ = rest_on_bones(
        resting, bones.rows, u, v, bones, placement, instant, range_of, recurrence, record
    )
    pull_weights(external, resting, u, v, nodes.inverse_mass, actions.weights, actions.activation, instant, keep, gain, dt, dt)
    kinetic = splat(0.0)
    work = splat(0.0)
    loss = splat(0.0)
    for at in range(0, u.size, WIDTH):
        old = load(v, at)
        push = load(external, at)
        new = keep * old + gain * load(nodes.inverse_mass, at) * (load(resting, at) + push)
        store(velocity, at, 0.5 * (old + new))
        momentum = load(nodes.mass, at) * old
        kinetic = kinetic + 0.5 * momentum * new
        work = work + 0.5 * dt * push * old
        loss = loss + 0.5 * dt * momentum * (old + new)
    driven_kinetic, driven_work, driven_loss = correct(
        u, v, force, external, velocity, nodes, actions.motion, instant, keep, alpha, dt
    )
    call_at(shared.addresses.internal_energy, (u, shared.blocks, lanes[0], lanes[1], lanes[2], energies))
    internal, hourglass, lost, barrier = energies[0], energies[1], energies[2], energies[3]
    for k, energy in enumerate(
        (
            internal,
            hourglass,
            sum_lanes(kinetic) + driven_kinetic,
            ledger[EXTERNAL_WORK] + sum_lanes(work) + driven_work + bone_work + tied + pressed + rubbed,
            ledger[DAMPING_LOSS] + 0.5 * alpha * (sum_lanes(loss) + driven_loss),
            lost,
            touching + pressed,
            tied,
            ledger[CONTACT_LOSS] + friction_loss + rubbed,
            barrier,
        )
    ):
        energies[k] = energy


def elastic_energy(energy_at, u, blocks, element_J, element_energy, element_hourglass, sums):
    """Strain energy, hourglass energy, energy lost and that of the barrier [J], and the former two of each element, (B, W)."""
    return call_at(energy_at, (u, blocks, element_J, element_energy, element_hourglass, sums))
