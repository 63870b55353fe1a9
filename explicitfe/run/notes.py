"""Sentences for the user: whether the mesh is the body that was meant, what holds it, and what to make of energies and forces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from explicitfe.mesh.soundness import Soundness, soundness
from explicitfe.model.model import Model
from explicitfe.run.work import balance_of
from explicitfe.solve.load_outcome import Equilibrium

# A specimen, or an organ: what lies outside has most likely another unit of length.
_SMALLEST_AND_LARGEST_EXTENT_MM = (1.0, 1000.0)
# Of the largest of work and stored energy: a balance that is off by more is told.
BALANCE_WARNING_SHARE = 1e-3
# Of the tool's force: where the base carries so much more or less, no equilibrium was reached.
_REACTION_WARNING_SHARE = 1e-2
# Of the force so far: what it may fall by, for rounding, while the tool goes deeper than before.
_FALL_WARNING_SHARE = 1e-2


def mesh_notes(model: Model, *, built_in: bool = False) -> tuple[str, ...]:
    """What a user should know of the mesh and of what holds it before believing any result; nothing where all is as usual.

    ``built_in``: the program has made the mesh, so that no element lies in another one; they are not compared.
    """
    body = soundness(model.mesh, overlap=not built_in)
    return tuple(
        note for note in (*_same_place(model, body), *_parts(model, body), *_overlap(model, body), *_extent(body)) if note
    )


def holding_nodes(model: Model) -> np.ndarray:
    """The nodes (n,) bool that something outside the body holds, in any direction: fixed, on springs, tied to a bone, or led.

    Bones that the body may touch hold nothing, nor do muscles that begin outside the body.
    """
    holds: np.ndarray = np.any(model.held, axis=1)
    if model.support is not None:
        holds[model.support.node] = True
    if model.motion is not None:
        holds[model.motion.nodes] = True
    for tie in model.attachments:
        holds[model.mesh.hexes[tie.points.element]] = True
    return holds


def _same_place(model: Model, body: Soundness) -> list[str]:
    if not len(body.same_place):
        return []
    first, second = body.same_place[np.lexsort(body.same_place.T[::-1])[0]]
    count = len(np.unique(body.same_place))
    return [
        f"{count} nodes of the mesh lie at the place of another one, such as {first} and {second} at "
        f"{_mm(model.mesh.points[first])} mm: what meets there is not joined, and comes apart or passes through itself; "
        "merge these nodes, unless they are a cut on purpose."
    ]


def _parts(model: Model, body: Soundness) -> list[str]:
    count = body.part_count
    held = np.zeros(count, dtype=bool)
    held[body.part[holding_nodes(model)[model.mesh.hexes].any(axis=1)]] = True
    loose = np.flatnonzero(~held)
    notes = []
    if count > 1:
        notes.append(
            f"the mesh consists of {count} parts that have no node in common, the smallest of {_around(model, body.part)}: they "
            "do not feel each other; join them by common nodes, or leave out what does not belong to the body."
        )
    if body.piece_count > count:
        notes.append(
            f"edges or single nodes alone join the mesh's {body.piece_count} pieces, the smallest of "
            f"{_around(model, body.piece)}, so that they turn about each other as on a hinge; let them share whole faces."
        )
    if count == 1 and len(loose):
        notes.append(
            "nothing holds the body, no fixed node, tie or spring: it moves and turns freely as a whole; fix a node set where it "
            "should stay in its place."
        )
    elif len(loose):
        free = np.where(np.isin(body.part, loose), body.part, -1)
        notes.append(
            f"nothing holds {len(loose)} of the {count} parts of the mesh, no fixed node, tie or spring, the smallest of "
            f"{_around(model, free)}: what pulls there moves it away freely; fix a node set of it, or join it to what is held."
        )
    return notes


def _around(model: Model, number: np.ndarray) -> str:
    """'12 elements around (1.0, 2.0, 3.0) mm', of the smallest of several parts; those of number -1 do not count."""
    sizes = np.bincount(number[number >= 0])
    smallest = int(np.argmin(np.where(sizes > 0, sizes, len(number) + 1)))
    own = np.flatnonzero(number == smallest)
    place = _mm(model.mesh.points[model.mesh.hexes[own]].mean(axis=(0, 1)))
    return f"{len(own)} element{'s' * (len(own) > 1)} around {place} mm"


def _overlap(model: Model, body: Soundness) -> list[str]:
    if not len(body.overlapping):
        return []
    number = body.overlapping[0]
    place = _mm(model.mesh.points[model.mesh.hexes[number]].mean(axis=0))
    return [
        f"{len(body.overlapping)} elements lie in the place of others at rest, such as {number} near {place} mm: the tissue is "
        "there twice, with twice its mass; remove what is double, or move the parts apart."
    ]


def _extent(body: Soundness) -> list[str]:
    extent_mm = 1e3 * body.extent_m
    smallest, largest = _SMALLEST_AND_LARGEST_EXTENT_MM
    if smallest <= extent_mm <= largest:
        return []
    size = "large" if extent_mm > largest else "small"
    return [
        f"the mesh is {extent_mm:.3g} mm long, very {size} for soft tissue: check its unit of length (length_unit of a model "
        "file, or a size in the scenario), as metres and millimetres are often taken for each other."
    ]


def _mm(place: np.ndarray) -> str:
    return "(" + ", ".join(f"{1e3 * value:.1f}" for value in place) + ")"


def balance_notes(error: float, barrier_share: float) -> list[str]:
    """What a user should know of the energy balance of a run in time.

    Parameters
    ----------
    error : the largest so far, as the ledger has it.
    barrier_share : the largest energy of the barrier against folding, as a share of the elastic energy then.
    """
    if not error > BALANCE_WARNING_SHARE:
        return []
    where = ""
    if barrier_share > BALANCE_WARNING_SHARE:
        where = (
            f", and the barrier against folding stored up to {_percent(barrier_share)} of the elastic energy: where a body that "
            "swings freely meets it as a wall, energy is made or lost"
        )
    return [
        f"the energy balance is off by up to {_percent(error)}: the step is long for how fast things change{where}; give "
        "model.damping or a smaller analysis.step_us and compare before quoting numbers."
    ]


def equilibrium_notes(curve: Sequence[Equilibrium], *, elastic: bool) -> list[str]:
    """What a user should know of the equilibria of an indentation, from first touch on.

    ``elastic``: nothing in it depends on the path, so the force has to rise while the tool goes deeper than before.
    """
    return [*_energy_of_loads(curve), *_reaction(curve), *(_fall(curve) if elastic else []), *_no_contact(curve)]


def _energy_of_loads(curve: Sequence[Equilibrium]) -> list[str]:
    error, doubt = balance_of(curve)
    if not error > BALANCE_WARNING_SHARE:
        return []
    begin = f"the stored energy and the work of the tool differ by {_percent(error)}"
    if error <= doubt:
        return [
            f"{begin}, where the work itself is not known better than to {_percent(doubt)} from {len(curve) - 1} "
            f"load{'s' * (len(curve) > 2)}: give more loads on the way, if the balance is to be a check."
        ]
    return [
        f"{begin}, more than the {_percent(doubt)} to which {len(curve) - 1} loads tell the work: something gives way between "
        "two loads, such as elements that fold at the tool's edge, or a material with a memory changes much in the time between "
        "them; give more loads on the way, or model.refinement = 2, and compare."
    ]


def _reaction(curve: Sequence[Equilibrium]) -> list[str]:
    largest_N = max((abs(point.force_N) for point in curve), default=0.0)
    off_N = max((abs(point.reaction_N - point.force_N) for point in curve), default=0.0)
    if not off_N > _REACTION_WARNING_SHARE * largest_N:
        return []
    return [
        f"the base carries up to {off_N:.3g} N more or less than the tool presses with, {_percent(off_N / largest_N)} of its "
        "largest force: the equilibria are rough; give a smaller analysis.tolerance."
    ]


def _fall(curve: Sequence[Equilibrium]) -> list[str]:
    """Where the force falls, or a tool under a growing force comes back."""
    deepest = curve[0] if curve else None
    for point in curve[1:]:
        assert deepest is not None
        if point.displacement_m > deepest.displacement_m:
            if point.force_N < (1.0 - _FALL_WARNING_SHARE) * deepest.force_N:
                return [
                    f"the force falls from {deepest.force_N:.3g} to {point.force_N:.3g} N while the tool goes deeper, from "
                    f"{1e3 * deepest.displacement_m:.3g} to {1e3 * point.displacement_m:.3g} mm, which tissue without a memory "
                    'does not do: elements give way; compare with model.refinement = 2 and with element = "hex8-full".'
                ]
            deepest = point
    return []


def _no_contact(curve: Sequence[Equilibrium]) -> list[str]:
    missed = [point for point in curve[1:] if point.displacement_m > 0.0 and point.force_N == 0.0]
    if not missed:
        return []
    return [
        f"the tool touches nothing though it has come down by {1e3 * missed[0].displacement_m:.3g} mm: what it pressed has moved "
        "away from it, or lies beside it."
    ]


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"
