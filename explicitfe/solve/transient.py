"""Drives a simulation in time: how long a step is, when the stable step is looked at, when to stop; never a Python step."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from explicitfe.compiled.arrays import EXTERNAL, HOURGLASS, INTERNAL, KINETIC, SMALLEST_CORNER, SMALLEST_J
from explicitfe.errors import InputError, RunError
from explicitfe.solve.simulation import Simulation, Snapshot
from explicitfe.solve.stable_step import STEP_SHARE_OF_LIMIT

FINISHED, INVERTED, UNSTABLE, DIVERGED, INTERRUPTED = "finished", "inverted", "unstable", "diverged", "interrupted"

# The stable step is looked at again when some element may have been strained by this much since, at the rate it had then: a
# step force can distort the elements at its node within a few steps.
STRAIN_BETWEEN_LOOKS = 0.15
FEWEST_STEPS_BETWEEN_LOOKS, MOST_STEPS_BETWEEN_LOOKS = 2, 100
TURNS_AT_THE_START, TURNS_LATER = 40, 4  # of the iteration that finds the limit: at the start, and later from what it found
# The step is kept while it lies between these shares of the limit: each change costs the energy balance a little.
LOWEST_STEP_SHARE = 0.82
# Hourglass energy means something where the elastic energy is at least this share of its largest.
ELASTIC_FLOOR_SHARE = 0.01
# Elastic energy below this share of the largest external work and kinetic energy is rounding: a body in free fall has none.
ROUNDING_SHARE = 1e-12


@dataclass(frozen=True)
class Status:
    """How a run ended: a state and, unless it finished, a sentence a user can act on."""

    state: str
    message: str = ""


class Transient:
    """Advances a simulation to its end with the largest stable step.

    The step is 0.9 of the limit that a Lanczos iteration gives for the current state, looked at every 2 to 100 steps, and
    divides the time to the next load edge into equal parts. Samples are taken at the first instant at or after the time
    asked for, and never change the step.

    Parameters
    ----------
    simulation : at time 0.
    duration_s : where to end.
    step_s : a fixed step instead.

    Raises
    ------
    InputError : ``step_s`` is above the stable limit.
    """

    def __init__(self, simulation: Simulation, duration_s: float, step_s: float | None = None) -> None:
        self.simulation = simulation
        self.duration_s = duration_s
        self.step_s = step_s
        edges = simulation.loads.edges_s
        self._marks = np.append(edges[(edges > 0.0) & (edges < duration_s * (1.0 - 1e-9))], duration_s)
        self._mark = 0
        self._since = 0  # steps since the limit was looked at
        self._cadence = FEWEST_STEPS_BETWEEN_LOOKS
        self._left = 0  # steps to the next mark
        self.limit_s = simulation.stable_limit(TURNS_AT_THE_START)
        self.smallest_dt_s = np.inf
        self.largest_fraction = 0.0
        if step_s is not None and step_s > self.limit_s:
            number = simulation.limiting_element()
            raise InputError(
                f"analysis.step_us = {1e6 * step_s:g} is unstable: the largest stable step of this model is "
                f"{1e6 * self.limit_s:.4g} microseconds (set by element {number}); take a smaller one or leave the key out."
            )
        self._dt = 0.0
        self._divide(step_s or STEP_SHARE_OF_LIMIT * self.limit_s)
        simulation.start(self._dt)

    @property
    def finished(self) -> bool:
        return self.simulation.time_s >= self.duration_s

    def advance_to(self, time_s: float) -> Status | None:
        """Advance to the first instant at or after ``time_s``; a status if the run cannot go on."""
        simulation = self.simulation
        while simulation.time_s < min(time_s, self.duration_s) - 1e-6 * self._dt:
            if self._since >= self._cadence:
                status = self._look()
                if status:
                    return status
            target = min(time_s, self.duration_s)
            wanted = int(np.ceil((target - simulation.time_s) / self._dt - 1e-6))
            steps = max(1, min(wanted, self._left, self._cadence - self._since))
            before = simulation.steps
            if not simulation.advance(steps, self._dt):
                return self._inverted()
            done = simulation.steps - before
            self._since = self._since + done if done == steps else self._cadence
            self._left -= done
            if self._left == 0:
                simulation.time_s = float(self._marks[self._mark])
                self._mark += 1
                if not self.finished:
                    self._divide(self.step_s or STEP_SHARE_OF_LIMIT * self.limit_s)
        return None

    def samples(self, every_s: float) -> Iterator[Snapshot]:
        """The state now, and at the first instant at or after each multiple of ``every_s`` up to the end.

        Raises
        ------
        RunError : the run cannot go on; what it gave until then stands.
        """
        yield self.simulation.snapshot()
        while not self.finished:
            passed = int(np.floor(self.simulation.time_s / every_s + 1e-9))
            status = self.advance_to(min((passed + 1) * every_s, self.duration_s))
            if status is not None:
                raise RunError(status.message)
            yield self.simulation.snapshot()

    def _look(self) -> Status | None:
        """Find the stable limit of the present state, and the step from it."""
        before = self.limit_s
        self.limit_s = self.simulation.stable_limit(TURNS_LATER)
        self._since = 0
        if not np.isfinite(self.limit_s):
            return self._inverted()
        self.largest_fraction = max(self.largest_fraction, self._dt / self.limit_s)
        fall = 1.0 - self.limit_s / before
        strain = self.simulation.largest_strain_rate() * self._dt
        # Twice as many as last time at most: a body that starts from rest has no rate yet.
        most = min(MOST_STEPS_BETWEEN_LOOKS, 2 * self._cadence)
        self._cadence = int(np.clip(STRAIN_BETWEEN_LOOKS / max(strain, 1e-12), FEWEST_STEPS_BETWEEN_LOOKS, most))
        if self.step_s is not None and self.step_s > self.limit_s:
            return Status(
                UNSTABLE,
                f"at {1e3 * self.simulation.time_s:.3f} ms the fixed step of {1e6 * self.step_s:g} microseconds has become "
                f"unstable: the tissue has stiffened and its limit is now {1e6 * self.limit_s:.4g} microseconds; "
                "leave analysis.step_us out or make it smaller.",
            )
        if self.step_s is None and not LOWEST_STEP_SHARE * self.limit_s <= self._dt <= STEP_SHARE_OF_LIMIT * self.limit_s:
            # A limit that is falling will go on falling until the next look.
            self._divide(STEP_SHARE_OF_LIMIT * self.limit_s * (1.0 - max(fall, 0.0)))
        return None

    def _divide(self, longest_s: float) -> None:
        """Equal steps, no longer than this, from here to the next mark."""
        time_left = self._marks[self._mark] - self.simulation.time_s
        self._left = max(1, int(np.ceil(time_left / longest_s - 1e-9)))
        self._dt = float(time_left / self._left)
        self.smallest_dt_s = min(self.smallest_dt_s, self._dt)
        self.largest_fraction = max(self.largest_fraction, self._dt / self.limit_s)

    def _inverted(self) -> Status:
        simulation = self.simulation
        worst = simulation.broken_element()
        J = simulation.ledger[SMALLEST_J]
        x, y, z = 1e3 * simulation.model.mesh.points[simulation.model.mesh.hexes[worst]].mean(axis=0)
        folded = J > 0.0 and not simulation.ledger[SMALLEST_CORNER] > 0.0
        how = "folded at a corner" if folded else f"turned inside out (J = {J:.3g})"
        return Status(
            INVERTED,
            f"at {1e3 * simulation.time_s:.3f} ms (step {simulation.steps}) element {worst} near "
            f"({x:.1f}, {y:.1f}, {z:.1f}) mm {how}: the forces there are too large for the "
            "tissue or the elements too coarse; lower force_N, choose another distribution or refine the mesh.",
        )

    # ---- restart ----

    def restart_state(self) -> dict[str, np.ndarray]:
        """Everything that the future depends on; minus the internal force follows from u, bit by bit."""
        return {
            "clock": np.array([self._dt, self.limit_s, self.smallest_dt_s, self.largest_fraction]),
            "counters": np.array([self._mark, self._since, self._cadence, self._left], dtype=np.int64),
            **self.simulation.restart_state(),
        }

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Go on from a restart state of the same model."""
        self._dt, self.limit_s, self.smallest_dt_s, self.largest_fraction = (float(x) for x in state["clock"])
        self._mark, self._since, self._cadence, self._left = (int(x) for x in state["counters"])
        self.simulation.restore(state)


def balance(energies: np.ndarray) -> float:
    """What is stored and what has been lost, less the work done from outside [J]: it does not change in time."""
    return float(np.delete(energies, EXTERNAL).sum() - energies[EXTERNAL])


@dataclass
class Ledger:
    """Energies over the samples of a run, and what they say about it."""

    energies: list[np.ndarray] = field(default_factory=list)
    balance_error: float = 0.0
    _scale: float = 0.0

    def add(self, snapshot: Snapshot) -> float:
        """Note a sample; its balance error relative to the largest of external work, internal and kinetic energy so far."""
        e = snapshot.energies
        self.energies.append(e)
        self._scale = max(self._scale, abs(e[EXTERNAL]), e[INTERNAL] + e[HOURGLASS], e[KINETIC])
        error = abs(balance(e) - balance(self.energies[0])) / self._scale if self._scale > 0.0 else 0.0
        self.balance_error = max(self.balance_error, error) if np.isfinite(error) else np.inf
        return error

    @property
    def hourglass_share(self) -> float:
        """Largest share of the hourglass energy in the elastic energy, where that is not next to nothing."""
        energies = np.array(self.energies)
        elastic = energies[:, INTERNAL] + energies[:, HOURGLASS]
        elastic_enough = elastic > max(ELASTIC_FLOOR_SHARE * elastic.max(initial=0.0), self._rounding_J)
        return float(np.max(energies[elastic_enough, HOURGLASS] / elastic[elastic_enough], initial=0.0))

    @property
    def hourglass_share_at_end(self) -> float:
        """Share of the hourglass energy in the elastic energy at the last sample."""
        e = self.energies[-1]
        elastic = e[INTERNAL] + e[HOURGLASS]
        return float(e[HOURGLASS] / elastic) if elastic > self._rounding_J else 0.0

    @property
    def _rounding_J(self) -> float:
        energies = np.array(self.energies)
        return ROUNDING_SHARE * np.abs(energies[:, [EXTERNAL, KINETIC]]).max(initial=0.0)
