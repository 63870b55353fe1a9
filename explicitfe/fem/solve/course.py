"""The course of a run between two returns to python, compiled: steps, samples and looks at the stable step."""

from __future__ import annotations

import math
from typing import Any

from explicitfe.fem.forces.apart import add_surface_pressure
from explicitfe.fem.forces.element_stress import add_stress
from explicitfe.fem.forces.reaction import sum_reactions
from explicitfe.fem.solve.look import (
    FEWEST_TURNS,
    FIRST_TOUCHES,
    LONGEST_STEP_SHARE,
    MAXIMUM,
    SHORT_WAIT_STEPS,
    STEPS_IN_A_PERIOD,
    STEPS_THAT_CALL_FOR_ALL_TURNS,
    Ceilings,
    allow_growth,
    calls_for_another_step,
    is_due,
    limit_of,
    margins_of,
    note_limit,
    plan_next_scan,
    smallest,
    steps_ahead,
)
from explicitfe.fem.solve.stable_step import STEP_SHARE_OF_LIMIT
from explicitfe.platform.compiled.arrays import (
    CEILING,
    CORNER,
    IN_ALL,
    IN_LOOKS,
    IN_SAMPLES,
    LIMIT,
    PERIOD,
    SINCE,
    SMALLEST_J,
    STIFFEST,
    WAIT,
    BoneRecord,
)
from explicitfe.platform.compiled.contact_arrays import FARTHEST, SPEED
from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.pieces import call_at
from explicitfe.platform.compiled.threads import asked_to_stop, ticks, wait

# Placeholders, bound in solve/kernels.py.
advance: Any = None
snapshot: Any = None

NO_LOOKS, AUTOMATIC_STEP, UNDAMPED_STEP, FIXED_STEP, LIMIT_ALONE = range(5)  # what ``looking`` can be
# There are no more turns once the square of the highest frequency rises by less than this share in one; but it may pause for some
# turns before it rises on, and so all turns are made.
NOT_SETTLED = -1.0
# A look after few turns has confirmed the limit if it comes to this share of it.
SURE_SHARE_OF_LIMIT = 0.995


def course(state, part, looks, looker, shared, actions, samples, instant, span, ledgers):
    """Advance a part of the state by up to ``steps`` steps of length dt; give the number of steps done.

    The threads of all parts call this at the same time. It ends early, after the step in which an element has turned inside out
    or folded, after one in which the barrier or a contact has become so stiff that a look is due, and after a look that calls for
    another step. Where the limit alone is asked for, it seeks that of the present state at once, and takes no step.

    Parameters
    ----------
    state, part, shared, actions : as for ``step.advance``; the instants are those of the steps, and one more.
    looks, looker : of the whole mesh and of the part.
    samples : Samples; the instants are counted from the first one here.
    instant : 0, where it begins: no literal, for which the compiler would make machine code of its own.
    span : Span.
    ledgers : (parts, LEDGER). That of each part, changed in place.
    """
    dt_before, dt, steps, looking, turns, length, contact_frequency = span
    addresses = shared.addresses
    watch = looker.watch
    margins = margins_of(looking == UNDAMPED_STEP)
    ledger = ledgers[part.number]
    taken = instant
    begin = ticks()
    while True:
        if taken < len(samples.instant) and samples.instant[taken] == instant:
            if part.number == 0:
                now = ticks()
                call_at(addresses.gather, (state, shared, actions, instant, dt_before, ledgers, samples, taken))
                looks.spent[IN_SAMPLES] += ticks() - now
            taken += 1
            wait(part.gate, part.parts)
        if instant == steps and looking != LIMIT_ALONE:
            break
        end = steps
        if looking != NO_LOOKS:
            if watch[WAIT] <= 0.0:
                now = ticks()
                ahead = 0.0
                if looking != LIMIT_ALONE:
                    call_at(addresses.scan, (state, part, looks, looker, shared.nodes, dt))
                    ahead = steps_ahead(part, looks)
                sought = is_due(watch, ahead)
                if sought:
                    wait(part.gate, part.parts)  # two sums in one place
                    barrier = -smallest(looks.sums, part, MAXIMUM, -part.blocks.corner[STIFFEST])
                    nearest = part.blocks.corner[CORNER]  # a look evaluates forces beside the present state
                    thorough = looking != AUTOMATIC_STEP or needs_all_turns(watch, ahead, barrier, margins)
                    while True:
                        most = turns if thorough else FEWEST_TURNS
                        differencing = (most, NOT_SETTLED, length, addresses.internal_force)
                        highest = call_at(
                            addresses.highest_frequency, (state, part, looks, looker, actions, instant, *differencing)
                        )
                        limit = min(limit_of(highest, contact_frequency), limit_of_passage(actions.surfaces.numbers))
                        if thorough or limit >= SURE_SHARE_OF_LIMIT * watch[LIMIT]:
                            break
                        thorough = True
                        wait(part.gate, part.parts)
                    # a vibration that few turns have missed can only make the limit shorter
                    note_limit(watch, limit if thorough else min(limit, watch[LIMIT]))
                    if looking == LIMIT_ALONE:
                        break
                    part.blocks.corner[CORNER] = nearest
                    if thorough:
                        watch[CEILING] = barrier + margins.barrier * highest * highest
                        allow_growth(part, looks, highest * highest, dt / limit, margins)
                        wait(part.gate, part.parts)
                        ahead = steps_ahead(part, looks)
                plan_next_scan(watch, ahead)
                if part.number == 0:
                    looks.spent[IN_LOOKS] += ticks() - now
                if sought and calls_for_another_step(watch, dt, looking == FIXED_STEP, margins):
                    break
            end = min(end, instant + int(watch[WAIT]))
        if taken < len(samples.instant):
            end = min(end, samples.instant[taken])
        ceilings = Ceilings(math.inf, margins.fall, math.inf)
        if looking != NO_LOOKS:
            stiffest = watch[CEILING] + more_room(watch, dt, margins)
            ceilings = Ceilings(stiffest, margins.fall, room_of_contact(watch, dt, contact_frequency))
        reached = advance(state, part, shared, actions, dt_before, dt, ceilings, instant, end, ledger)
        watch[SINCE] += reached - instant
        watch[WAIT] -= reached - instant
        watch[PERIOD] += reached - instant
        dt_before = dt
        instant = reached
        wait(part.gate, part.parts)
        if asked_to_stop(part.gate):
            if looking != NO_LOOKS:  # the next call begins with a look
                watch[WAIT], watch[SINCE] = 0.0, STEPS_THAT_CALL_FOR_ALL_TURNS
            break
    if part.number == 0:
        looks.spent[IN_ALL] += ticks() - begin
    return instant


@leaf
def limit_of_passage(numbers):
    """The longest step [s] in which no node of a surface can move through a face."""
    return numbers[FARTHEST] / numbers[SPEED] if numbers[SPEED] > 0.0 else math.inf


@leaf
def needs_all_turns(watch, ahead, barrier, margins):
    """Whether few turns may miss something: a bound or the barrier calls, the step may be lengthened, or the barrier is stiff.

    Otherwise no node's bound has grown by what it may since all turns were made last, and few turns follow the same vibration.
    The barrier counts as stiff above the increase that is allowed between two stability checks.
    """
    stiff = barrier > margins.barrier * (2.0 / watch[LIMIT]) ** 2
    due = watch[PERIOD] >= STEPS_IN_A_PERIOD or watch[SINCE] >= STEPS_THAT_CALL_FOR_ALL_TURNS
    return stiff or due or not ahead >= SHORT_WAIT_STEPS


@leaf
def more_room(watch, dt, margins):
    """By how much more the barrier may stiffen where the step is shorter than the usual share of the limit [1/s^2].

    The squares of the highest frequencies of two stiffnesses add up at most.
    """
    usual = (STEP_SHARE_OF_LIMIT * 2.0 / dt) ** 2 - (2.0 / watch[LIMIT]) ** 2
    return max(0.0, (1.0 + margins.barrier) * usual) if margins.longest == LONGEST_STEP_SHARE else 0.0


@leaf
def room_of_contact(watch, dt, contact_frequency):
    """How much stiffer contact with bone may become before a stability check is due, over its stiffness at first touch.

    The squares of the highest frequencies of two stiffnesses add up at most. ``limit_of`` leaves some room at least.
    """
    room = (2.0 / dt) ** 2 - (2.0 / watch[LIMIT]) ** 2
    return FIRST_TOUCHES * max(1.0, room / (contact_frequency * contact_frequency))


def gather(state, shared, actions, instant, dt, ledgers, samples, number):
    """Write the present state, that of an instant, into a sample; give 0."""
    rows, lanes = samples.rows, samples.lanes
    ledger = samples.ledger
    for entry in range(len(ledger)):
        ledger[entry] = ledgers[0, entry]
        for other in range(1, len(ledgers)):
            theirs = ledgers[other, entry]
            if entry < SMALLEST_J:
                ledger[entry] += theirs
            elif not theirs >= ledger[entry]:
                ledger[entry] = theirs
    record = BoneRecord(samples.contact[number], samples.point_pressure)
    snapshot(state, shared, actions, instant, dt, ledger, rows, record, lanes, samples.energies[number])
    others = rows[0], rows[1], shared.external, shared.nodes, actions.ties, shared.alpha, dt
    sum_reactions(samples.reaction[number], samples.holders, state.v, *others)
    samples.smallest_J[number] = ledger[SMALLEST_J]
    samples.taken[0] = number + 1
    u, velocity = state.u, rows[0]
    for node in range(len(samples.node)):
        row = samples.node[node]
        for k in range(3):
            samples.displacement[number, node, k] = u[row, k]
            samples.velocity[number, node, k] = velocity[row, k]
    for element in range(len(samples.element)):
        lane = samples.element[element]
        block, at = lane // lanes.shape[2], lane % lanes.shape[2]
        samples.J[number, element] = lanes[0, block, at]
        samples.hourglass[number, element] = lanes[2, block, at]
    if samples.stress.shape[1] > 0:
        into = samples.stress[number], samples.J[number]
        add_stress(into[0], into[1], samples.element, samples.detached, u, shared.addresses.internal_force)
    add_surface_pressure(actions.surfaces, samples.pressed[number], samples.pairs[number])
    bones = actions.bones
    for bone in range(len(bones.start)):
        for point in range(len(samples.touching)):
            samples.pressure[number, bone, samples.touching[point]] = samples.point_pressure[bone, point]
    return 0.0
