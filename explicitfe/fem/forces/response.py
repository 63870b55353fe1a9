"""What W elements answer to their deformation: the stress, and the slope that hourglass control scales with.

Without effects that is the law itself. With effects the law's slopes are stiffened and softened, fibres are added, and
what is isochoric and what is volumetric relax each by itself; all is stated once, here, for transient runs, equilibria and
single points alike.

What an effect does stands in leaves of its own file; each fills a slot. The table ``SLOTS`` says what a slot is when nobody fills
it, and how two effects share it: they add up, or they are refused when the model is built.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from explicitfe.fem.effects.effect import MaterialEffect, remember, remembered
from explicitfe.fem.materials import Leaves, volumetric
from explicitfe.fem.materials.kinematics import inverse_C, plus, right_cauchy_green
from explicitfe.platform.compiled.jit import PLACEHOLDER, Dispatcher, Template, bind, leaf
from explicitfe.platform.compiled.simd import WIDTH, inverse_cube_root, load_many
from explicitfe.platform.errors import InputError, nearest

# Placeholders, bound below.
law_stress = law_delta_slope = law_energy = law_isochoric = law_slopes = PLACEHOLDER
invariants = raised = lowered = stiffened = total = second_stress = PLACEHOLDER
stiffen = soften = recoverable = pull = relax = branch_energy = dilate = dilation_energy = drain = held = PLACEHOLDER
first_leaf = second_leaf = nobody_leaf = PLACEHOLDER
LAW_CONSTANTS = 1
AT = 0
COUNTS_WORK = 1  # 0 where nobody asks for the work of the stress

# Where the work of the stress is remembered, before what effects remember: F (9), P (9), delta, slope, work.
WORK_P, WORK_DELTA, WORK_SLOPE, WORK_DONE, WORK_MEMORY = 9, 18, 19, 20, 21
# Where a material that rests without strain does not remember zero: F = 1.
AT_REST = {0: 1.0, 4: 1.0, 8: 1.0}


def bound_constants(law: Leaves) -> Dispatcher:
    """The leaf that gives the constants of a law in W elements."""
    return bind(law_constants, inline=True, LAW_CONSTANTS=law.count)


def law_constants(blocks, block):
    """Constants of the law, (LAW_CONSTANTS,), of W elements; one block has those of all where they are the same."""
    return load_many(blocks.constants, min(block, len(blocks.constants) - 1) * (LAW_CONSTANTS * WIDTH), LAW_CONSTANTS)


def elastic(F, cof, J, delta, c, blocks, block):
    """First Piola-Kirchhoff stress (9) [Pa] and the slope for hourglass control [Pa]."""
    return law_stress(F, cof, J, delta, c), law_delta_slope(F, cof, J, delta, c)


def elastic_energy(F, cof, J, delta, c, blocks, block):
    """Stored energy [Pa], that of hourglass control, and what has been lost so far."""
    alone = law_energy(F, J, 0.0 * J, c)
    e = law_energy(F, J, delta, c) - alone
    return alone, e, 0.0 * J


def with_effects(F, cof, J, delta, c, blocks, block):
    """First Piola-Kirchhoff stress (9) [Pa] and the slope for hourglass control [Pa]."""
    here = raised(invariants(F, cof, J), delta)
    more, more_energy = stiffen(here[0], blocks, block)
    factor = soften(law_isochoric(here, c) + more_energy, blocks, block)
    slopes = stiffened(law_slopes(here, c), more, factor)
    root = inverse_cube_root(J)
    square = root * root
    inverse = inverse_C(cof, J)
    whole = second_stress(slopes, right_cauchy_green(F), inverse, square)
    fibre, _ = pull(F, square, inverse, blocks, block)
    S = plus(whole, fibre)
    T, share = relax(S, blocks, block)
    p = drain(dilate(J, c[LAW_CONSTANTS - 1], blocks, block), blocks, block)
    P = (
        F[0] * T[0] + F[1] * T[3] + F[2] * T[4] + p * cof[0],
        F[0] * T[3] + F[1] * T[1] + F[2] * T[5] + p * cof[1],
        F[0] * T[4] + F[1] * T[5] + F[2] * T[2] + p * cof[2],
        F[3] * T[0] + F[4] * T[3] + F[5] * T[4] + p * cof[3],
        F[3] * T[3] + F[4] * T[1] + F[5] * T[5] + p * cof[4],
        F[3] * T[4] + F[4] * T[5] + F[5] * T[2] + p * cof[5],
        F[6] * T[0] + F[7] * T[3] + F[8] * T[4] + p * cof[6],
        F[6] * T[3] + F[7] * T[1] + F[8] * T[5] + p * cof[7],
        F[6] * T[4] + F[7] * T[5] + F[8] * T[2] + p * cof[8],
    )
    slope = total(slopes) * share
    if not COUNTS_WORK:
        return P, slope
    work = remembered(blocks, block, WORK_DONE)
    change = delta - remembered(blocks, block, WORK_DELTA)
    work = work + 0.5 * (slope + remembered(blocks, block, WORK_SLOPE)) * change
    for k in range(9):
        work = work + 0.5 * (P[k] + remembered(blocks, block, WORK_P + k)) * (F[k] - remembered(blocks, block, k))
    for k in range(9):
        remember(blocks, block, k, F[k])
        remember(blocks, block, WORK_P + k, P[k])
    remember(blocks, block, WORK_DELTA, delta)
    remember(blocks, block, WORK_SLOPE, slope)
    remember(blocks, block, WORK_DONE, work)
    return P, slope


def energy_with_effects(F, cof, J, delta, c, blocks, block):
    """Stored energy [Pa], that of hourglass control, and what has been lost so far: the work of the stress less what is stored.

    Of the accepted state: F and J are those that ``blocks.old`` was made with.
    """
    here = raised(invariants(F, cof, J), delta)
    K = c[LAW_CONSTANTS - 1]
    more, more_energy = stiffen(here[0], blocks, block)
    W = recoverable(law_isochoric(here, c) + more_energy, blocks, block)
    root = inverse_cube_root(J)
    square = root * root
    C = right_cauchy_green(F)
    _, fibre_energy = pull(F, square, inverse_C(cof, J), blocks, block)
    modulus = 2.0 * (total(law_slopes(here, c)) + more) * square
    kept, branches = branch_energy(C, modulus, blocks, block)
    whole = kept * (W + fibre_energy) + branches + held(dilation_energy(J, K, blocks, block), K, blocks, block)
    e = kept * (law_isochoric(here, c) - law_isochoric(lowered(here, delta), c))
    return whole - e, e, remembered(blocks, block, WORK_DONE) - whole


# ---- slots: what stands in each where no effect fills it, and how two effects share it ----


@leaf
def no_stiffening(I1_bar, blocks, block):
    """What is added to dW/dI1_bar and to W [Pa]."""
    return 0.0 * I1_bar, 0.0 * I1_bar


@leaf
def no_softening(W, blocks, block):
    """The factor of the isochoric stress at the energy W [Pa]."""
    return 0.0 * W + 1.0


@leaf
def all_recoverable(W, blocks, block):
    """The part of the energy W that unloading gives back [Pa]."""
    return W


@leaf
def no_fibres(F, square, inverse, blocks, block):
    """Second Piola-Kirchhoff stress (6) and energy [Pa] that is added to the law's; J^(-2/3) is ``square``, C^-1 ``inverse``."""
    zero = 0.0 * square
    return (zero, zero, zero, zero, zero, zero), zero


@leaf
def no_relaxation(S, blocks, block):
    """What is left of the isochoric stress S (6) [Pa], and the share of it that hourglass control keeps."""
    return S, 0.0 * S[0] + 1.0


@leaf
def no_branches(C, modulus, blocks, block):
    """The share of the energy that is kept in the long run, and what the effect stores beside it [Pa]."""
    return 0.0 * modulus + 1.0, 0.0 * modulus


@leaf
def law_pressure(J, K, blocks, block):
    """The elastic pressure U'(J) [Pa]; K is the bulk modulus."""
    return volumetric.pressure(J, K)


@leaf
def law_dilation_energy(J, K, blocks, block):
    """The volumetric energy U(J) [Pa]; K is the bulk modulus."""
    return volumetric.energy(J, K)


@leaf
def no_drainage(p, blocks, block):
    """What is left of the elastic pressure [Pa]."""
    return p


@leaf
def all_held(U, K, blocks, block):
    """What is stored of the volumetric energy U [Pa]; K is the bulk modulus."""
    return U


def both_stiffen(I1_bar, blocks, block):
    """The sum of two: slopes and energies add up."""
    one, one_energy = first_leaf(I1_bar, blocks, block)
    other, other_energy = second_leaf(I1_bar, blocks, block)
    return one + other, one_energy + other_energy


def both_pull(F, square, inverse, blocks, block):
    """The sum of two: stresses and energies add up."""
    a, one_energy = first_leaf(F, square, inverse, blocks, block)
    b, other_energy = second_leaf(F, square, inverse, blocks, block)
    return plus(a, b), one_energy + other_energy


def if_present(*arguments):
    """The leaf of an effect whose strength, its first number, is not 0; else that of no effect. Blocks and block are last."""
    if arguments[-2].effects[arguments[-1], AT, 0] == 0.0:
        return nobody_leaf(*arguments)
    return first_leaf(*arguments)


@dataclass(frozen=True)
class Slot:
    """A place in the response that leaves of effects can fill.

    Attributes
    ----------
    nobody : the leaf where no effect fills it; it says what a leaf of this slot takes and gives.
    both : how two effects share it; None where they cannot.
    refusal : then why they cannot, and what to do.
    """

    nobody: Dispatcher
    both: Template | None = None
    refusal: str = ""


_ONE_SOFTENING = "one law of softening does not say what another has left of the stress; take one of them out"
_ONE_RELAXATION = "one series of relaxation does not say what another has left of the stress; put all terms into one effect"
_ONE_DILATION = "one volumetric energy does not know that of another; take one of them out"
_ONE_DRAINAGE = "one law of drainage does not say what another has left of the pressure; take one of them out"

# In the order in which the response asks them.
SLOTS: dict[str, Slot] = {
    "stiffen": Slot(no_stiffening, both_stiffen),
    "soften": Slot(no_softening, refusal=_ONE_SOFTENING),
    "recoverable": Slot(all_recoverable, refusal=_ONE_SOFTENING),
    "pull": Slot(no_fibres, both_pull),
    "relax": Slot(no_relaxation, refusal=_ONE_RELAXATION),
    "branch_energy": Slot(no_branches, refusal=_ONE_RELAXATION),
    "dilate": Slot(law_pressure, refusal=_ONE_DILATION),
    "dilation_energy": Slot(law_dilation_energy, refusal=_ONE_DILATION),
    "drain": Slot(no_drainage, refusal=_ONE_DRAINAGE),
    "held": Slot(all_held, refusal=_ONE_DRAINAGE),
}


# ---- which effects, and where their numbers stand ----


class Place(NamedTuple):
    """An effect in the kernels of a model.

    Attributes
    ----------
    effect : its class.
    shape : what its leaves are compiled for, by placeholder.
    at : where its numbers begin in ``Blocks.effects``.
    memory : where what it remembers begins in ``Blocks.old`` and ``new``.
    """

    effect: type[MaterialEffect]
    shape: tuple[tuple[str, int], ...]
    at: int
    memory: int


Layout = tuple[Place, ...]


def layout_of(effects: Sequence[MaterialEffect]) -> Layout:
    """Where the numbers and the memory of each effect begin; the work of the stress is remembered before them.

    Raises
    ------
    InputError : an effect is there twice, or two effects need a slot that cannot be shared.
    """
    fills: dict[str, type[MaterialEffect]] = {}
    layout: list[Place] = []
    at, memory = 0, WORK_MEMORY
    for effect in effects:
        kind = type(effect)
        if any(place.effect is kind for place in layout):
            raise InputError(f"effects: {kind.about.title} is there twice; give it once.")
        for name in kind.leaves():
            if name not in SLOTS:
                raise InputError(
                    f'{kind.__name__}.leaves: the response of an element has no slot "{name}"; {nearest(name, SLOTS)}'
                )
            if name in fills and SLOTS[name].both is None:
                raise InputError(
                    f"effects: {fills[name].about.title} and {kind.about.title} cannot be combined: {SLOTS[name].refusal}."
                )
            fills[name] = kind
        layout.append(Place(kind, tuple(effect.shape.items()), at, memory))
        at, memory = at + effect.numbers, memory + effect.memory
    return tuple(layout)


def bound(law: Leaves, layout: Layout, counts_work: bool = True) -> tuple[Dispatcher, Dispatcher]:
    """Stress and energy of a law with effects, from their places; the energy needs the work of the stress to be counted."""
    if not layout:
        return (
            bind(elastic, inline=True, law_stress=law.stress, law_delta_slope=law.delta_slope),
            bind(elastic_energy, inline=True, law_energy=law.energy),
        )
    leaves = {name: slot.nobody for name, slot in SLOTS.items()}
    may_be_absent = any("NONLINEAR" in dict(place.shape) for place in layout)  # see effects/complete.py
    filled: set[str] = set()
    for place in layout:
        for name, template in place.effect.leaves().items():
            own = _bound_where_read(template, {"AT": place.at, "MEMORY": place.memory, **dict(place.shape)})
            if may_be_absent and not place.shape:
                own = bind(if_present, inline=True, first_leaf=own, nobody_leaf=SLOTS[name].nobody, AT=place.at)
            both = SLOTS[name].both
            if name in filled and both is not None:
                own = bind(both, inline=True, first_leaf=leaves[name], second_leaf=own)
            leaves[name] = own
            filled.add(name)
    kind = law.kind
    values = {
        "law_isochoric": law.isochoric_at,
        "law_slopes": law.slopes_at,
        "LAW_CONSTANTS": law.count,
        "COUNTS_WORK": int(counts_work),
        **{name: getattr(kind, name) for name in ("invariants", "raised", "lowered", "stiffened", "total", "second_stress")},
        **leaves,
    }
    return _bound_where_read(with_effects, values), _bound_where_read(energy_with_effects, values)


def _bound_where_read(template: Template, values: Mapping[str, Any]) -> Dispatcher:
    """A template with those of its placeholders bound that it reads."""
    reads = template.__code__.co_names
    return bind(template, inline=True, **{name: value for name, value in values.items() if name in reads})
