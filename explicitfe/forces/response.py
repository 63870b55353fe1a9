"""What W elements answer to their deformation: the stress, and the slope that hourglass control scales with.

Without effects that is the law itself. With effects the law's slope W' is stiffened and softened, fibres are added, and
what is isochoric and what is volumetric relax each by itself; all is stated once, here, for transient runs, equilibria and
single points alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType

from explicitfe.compiled.jit import Dispatcher, bind, leaf
from explicitfe.compiled.simd import inverse_cube_root
from explicitfe.effects.effect import remember, remembered
from explicitfe.effects.material import drainage, fibres, softening, third_yeoh, viscoelastic
from explicitfe.materials import volumetric
from explicitfe.materials.kinematics import isochoric_invariant

# Placeholders, bound below.
law_stress = law_slope = law_energy = law_isochoric = None
stiffen = soften = recoverable = pull = relax = branch_energy = drain = held = None
LAW_CONSTANTS = 1
WORK = 0  # where the work of the stress is remembered: F (9), P (9), delta, slope, work

WORK_MEMORY = 21
# Where a material that rests without strain does not remember zero: F = 1.
AT_REST = {0: 1.0, 4: 1.0, 8: 1.0}


def elastic(F, cof, J, delta, c, blocks, block):
    """First Piola-Kirchhoff stress (9) [Pa] and dW/dI1_bar [Pa]."""
    return law_stress(F, cof, J, delta, c), law_slope(isochoric_invariant(F, J) + delta, c)


def elastic_energy(F, cof, J, delta, c, blocks, block):
    """Stored energy [Pa], that of hourglass control, and what has been lost so far."""
    alone = law_energy(F, J, 0.0 * J, c)
    e = law_energy(F, J, delta, c) - alone
    return alone, e, 0.0 * J


def with_effects(F, cof, J, delta, c, blocks, block):
    """First Piola-Kirchhoff stress (9) [Pa] and the slope for hourglass control [Pa]."""
    I1_bar = isochoric_invariant(F, J) + delta
    more, more_energy = stiffen(I1_bar, blocks, block)
    slope = law_slope(I1_bar, c) + more
    slope = slope * soften(law_isochoric(I1_bar, c) + more_energy, blocks, block)
    root = inverse_cube_root(J)
    square = root * root
    C = right_cauchy_green(F)
    inverse = inverse_C(cof, J)
    a = 2.0 * slope * square
    b = -(1.0 / 3.0) * a * (C[0] + C[1] + C[2])
    fibre, _ = pull(F, square, inverse, blocks, block)
    S = (
        a + b * inverse[0] + fibre[0],
        a + b * inverse[1] + fibre[1],
        a + b * inverse[2] + fibre[2],
        b * inverse[3] + fibre[3],
        b * inverse[4] + fibre[4],
        b * inverse[5] + fibre[5],
    )
    T, share = relax(S, blocks, block)
    p = drain(volumetric.pressure(J, c[LAW_CONSTANTS - 1]), blocks, block)
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
    slope = slope * share
    work = remembered(blocks, block, WORK + 20)
    change = delta - remembered(blocks, block, WORK + 18)
    work = work + 0.5 * (slope + remembered(blocks, block, WORK + 19)) * change
    for k in range(9):
        work = work + 0.5 * (P[k] + remembered(blocks, block, WORK + 9 + k)) * (F[k] - remembered(blocks, block, WORK + k))
    for k in range(9):
        remember(blocks, block, WORK + k, F[k])
        remember(blocks, block, WORK + 9 + k, P[k])
    remember(blocks, block, WORK + 18, delta)
    remember(blocks, block, WORK + 19, slope)
    remember(blocks, block, WORK + 20, work)
    return P, slope


def energy_with_effects(F, cof, J, delta, c, blocks, block):
    """Stored energy [Pa], that of hourglass control, and what has been lost so far: the work of the stress less what is stored.

    Of the accepted state: F and J are those that ``blocks.old`` was made with.
    """
    I1_bar = isochoric_invariant(F, J) + delta
    K = c[LAW_CONSTANTS - 1]
    more, more_energy = stiffen(I1_bar, blocks, block)
    W = recoverable(law_isochoric(I1_bar, c) + more_energy, blocks, block)
    root = inverse_cube_root(J)
    square = root * root
    C = right_cauchy_green(F)
    _, fibre_energy = pull(F, square, inverse_C(cof, J), blocks, block)
    modulus = 2.0 * (law_slope(I1_bar, c) + more) * square
    kept, branches = branch_energy(C, modulus, blocks, block)
    whole = kept * (W + fibre_energy) + branches + held(volumetric.energy(J, K), K, blocks, block)
    e = kept * (law_isochoric(I1_bar, c) - law_isochoric(I1_bar - delta, c))
    return whole - e, e, remembered(blocks, block, WORK + 20) - whole


@leaf
def right_cauchy_green(F):
    """C = F^T F: 11, 22, 33, 12, 13, 23."""
    return (
        F[0] * F[0] + F[3] * F[3] + F[6] * F[6],
        F[1] * F[1] + F[4] * F[4] + F[7] * F[7],
        F[2] * F[2] + F[5] * F[5] + F[8] * F[8],
        F[0] * F[1] + F[3] * F[4] + F[6] * F[7],
        F[0] * F[2] + F[3] * F[5] + F[6] * F[8],
        F[1] * F[2] + F[4] * F[5] + F[7] * F[8],
    )


@leaf
def inverse_C(cof, J):
    """C^-1 = (cof F)^T cof F / J^2: 11, 22, 33, 12, 13, 23."""
    w = 1.0 / (J * J)
    return (
        w * (cof[0] * cof[0] + cof[3] * cof[3] + cof[6] * cof[6]),
        w * (cof[1] * cof[1] + cof[4] * cof[4] + cof[7] * cof[7]),
        w * (cof[2] * cof[2] + cof[5] * cof[5] + cof[8] * cof[8]),
        w * (cof[0] * cof[1] + cof[3] * cof[4] + cof[6] * cof[7]),
        w * (cof[0] * cof[2] + cof[3] * cof[5] + cof[6] * cof[8]),
        w * (cof[1] * cof[2] + cof[4] * cof[5] + cof[7] * cof[8]),
    )


# ---- what an effect does where it is not there ----


@leaf
def no_stiffening(I1_bar, blocks, block):
    return 0.0 * I1_bar, 0.0 * I1_bar


@leaf
def no_softening(W, blocks, block):
    return 0.0 * W + 1.0


@leaf
def all_recoverable(W, blocks, block):
    return W


@leaf
def no_fibres(F, square, inverse, blocks, block):
    zero = 0.0 * square
    return (zero, zero, zero, zero, zero, zero), zero


@leaf
def no_relaxation(S, blocks, block):
    return S, 0.0 * S[0] + 1.0


@leaf
def no_branches(C, modulus, blocks, block):
    return 0.0 * modulus + 1.0, 0.0 * modulus


@leaf
def no_drainage(p, blocks, block):
    return p


@leaf
def all_held(U, K, blocks, block):
    return U


NEUTRAL = {
    "stiffen": no_stiffening,
    "soften": no_softening,
    "recoverable": all_recoverable,
    "pull": no_fibres,
    "relax": no_relaxation,
    "branch_energy": no_branches,
    "drain": no_drainage,
    "held": all_held,
}
# The leaves that an effect of the material brings, and what they are compiled for beside their place.
LEAVES: dict[str, tuple[ModuleType, tuple[str, ...], tuple[str, ...]]] = {
    "ThirdYeoh": (third_yeoh, ("stiffen",), ()),
    "Softening": (softening, ("soften", "recoverable"), ()),
    "Fibres": (fibres, ("pull",), ()),
    "Viscoelastic": (viscoelastic, ("relax", "branch_energy"), ("TERMS",)),
    "Drainage": (drainage, ("drain", "held"), ()),
}


def bound(law: ModuleType, effects: Sequence[tuple[str, tuple[int, ...], int, int]]) -> tuple[Dispatcher, Dispatcher]:
    """Stress and energy of a law with effects: each (its class, what it is compiled for, first number, first memory)."""
    common = {"law_slope": law.slope}
    if not effects:
        return (
            bind(elastic, inline=True, law_stress=law.stress, **common),
            bind(elastic_energy, inline=True, law_energy=law.energy),
        )
    leaves = dict(NEUTRAL)
    last = 0
    for name, shape, at, memory in effects:
        if name == "work":
            last = memory
            continue
        module, names, placeholders = LEAVES[name]
        values = {"AT": at, "MEMORY": memory, **dict(zip(placeholders, shape, strict=True))}
        for function in names:
            template = getattr(module, function)
            read = template.__code__.co_names
            leaves[function] = bind(template, inline=True, **{key: value for key, value in values.items() if key in read})
    common |= {
        "law_isochoric": law.isochoric,
        "LAW_CONSTANTS": law.CONSTANTS,
        "stiffen": leaves["stiffen"],
        "pull": leaves["pull"],
    }
    return (
        bind(
            with_effects, inline=True, **common, WORK=last, soften=leaves["soften"], relax=leaves["relax"], drain=leaves["drain"]
        ),
        bind(
            energy_with_effects,
            inline=True,
            **common,
            WORK=last,
            recoverable=leaves["recoverable"],
            branch_energy=leaves["branch_energy"],
            held=leaves["held"],
        ),
    )
