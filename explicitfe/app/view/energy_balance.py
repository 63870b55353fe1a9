"""The energy balance of a run: where the external work is stored, and where it is dissipated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from explicitfe.results.files import Result


@dataclass(frozen=True)
class BalanceTerm:
    """A column of the history that is part of the balance.

    Attributes
    ----------
    column : name in the history.
    label : name in a legend.
    colour : number of its colour, from 0. A loss has the colour of the stored energy that it is taken from.
    is_loss : whether the energy is dissipated; otherwise it is stored.
    """

    column: str
    label: str
    colour: int
    is_loss: bool = False


# The solver balances exactly these terms against the external work, see explicitfe.fem.solve.ledger.balance.
BALANCE_TERMS = (
    BalanceTerm("internal_energy", "strain energy", 0),
    BalanceTerm("barrier_energy", "barrier against inversion", 5),
    BalanceTerm("hourglass_energy", "hourglass control", 1),
    BalanceTerm("kinetic_energy", "kinetic energy", 2),
    BalanceTerm("contact_energy", "contact", 3),
    BalanceTerm("tied_energy", "springs and attachments", 4),
    BalanceTerm("material_loss", "material loss", 0, is_loss=True),
    BalanceTerm("damping_loss", "damping loss", 2, is_loss=True),
    BalanceTerm("contact_loss", "contact loss", 3, is_loss=True),
)
# SI prefixes: the first in whose unit the largest energy is at least 0.1 is used.
UNITS = ((1.0, "J"), (1e3, "mJ"), (1e6, "µJ"))
SMALLEST_UNIT = (1e9, "nJ")
SMALLEST_DRAWN_ENERGY = 0.1


@dataclass(frozen=True, eq=False)
class EnergyBalance:
    """The terms of the energy balance over time.

    Attributes
    ----------
    time : (t,) s.
    work : (t,) J. External work, plus the energy that is stored at the start.
    has_start : whether energy is stored at the start.
    terms : the terms that are not zero throughout, with their energies (t,) J; stored energies first. They add up to ``work``.
    """

    time: np.ndarray
    work: np.ndarray
    has_start: bool
    terms: list[tuple[BalanceTerm, np.ndarray]]

    @property
    def work_label(self) -> str:
        """Name of ``work`` in a legend."""
        return "external work + energy at the start" if self.has_start else "external work"

    def edges(self) -> np.ndarray:
        """Edges of the stacked terms (terms + 1, t) J, from zero upwards; the last edge equals ``work`` within the error."""
        energies = [np.zeros(len(self.time)), *(energy for _, energy in self.terms)]
        stacked: np.ndarray = np.cumsum(energies, axis=0)
        return stacked

    def unit(self) -> tuple[float, str]:
        """The factor from J to the unit in which the energies are drawn, and that unit."""
        largest = max(float(np.nanmax(np.abs(y), initial=0.0)) for y in (self.work, *(energy for _, energy in self.terms)))
        return next(((factor, unit) for factor, unit in UNITS if factor * largest >= SMALLEST_DRAWN_ENERGY), SMALLEST_UNIT)


def energy_balance(result: Result) -> EnergyBalance | None:
    """The energy balance of a run in time; None where its history has no energies or fewer than two samples."""
    names, time = set(result.history_names), result.history("time")
    if len(time) < 2 or not {"external_work", "balance_error"} <= names:
        return None
    every = [(term, result.history(term.column)) for term in BALANCE_TERMS if term.column in names]
    start = float(sum(energy[0] for _, energy in every))
    work = result.history("external_work") - float(result.history("external_work")[0]) + start
    return EnergyBalance(time, work, start != 0.0, [(term, energy) for term, energy in every if np.any(energy)])
