"""Advances a simulation in time: choice of the step, samples, and the end of a run. The steps themselves are compiled."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from explicitfe.fem.elements.barrier import MODULUS
from explicitfe.fem.inputs.argument import finite_number, number_like
from explicitfe.fem.inputs.limits import Positive
from explicitfe.fem.model.model import Model
from explicitfe.fem.solve.course import AUTOMATIC_STEP, FIXED_STEP, UNDAMPED_STEP
from explicitfe.fem.solve.look import (
    FEWEST_STEPS_BETWEEN_SCANS,
    LONGEST_STEP_SHARE,
    UNDAMPED_FALL_SHARE,
    UNDAMPED_LONGEST_STEP_SHARE,
)
from explicitfe.fem.solve.observe import Recording, Snapshot
from explicitfe.fem.solve.parts import for_threads
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.stable_step import STEP_SHARE_OF_LIMIT
from explicitfe.platform.compiled.arrays import (
    CORNER,
    FALL,
    INTERVAL,
    LIMIT,
    LOWEST_LIMIT,
    PERIOD,
    SMALLEST_CORNER,
    SMALLEST_J,
    WAIT,
)
from explicitfe.platform.errors import InputError, RunError, shortened
from explicitfe.platform.host import stopping

FINISHED, INVERTED, UNSTABLE, DIVERGED, INTERRUPTED = "finished", "inverted", "unstable", "diverged", "interrupted"
CROSSED = "crossed"

TURNS_AT_THE_START = 40  # of the iteration that finds the limit
SHORTENED_STEP_SHARE = (
    0.89  # of the limit: a step that has become too long is shortened a little further, as the limit may fall on
)
# The same for a body that nothing calms: see ``look.py``.
UNDAMPED_STEP_SHARE = 0.6
# Mass-proportional damping [1/s] that keeps the fastest vibrations of a tongue calm: seen with 20, not with 5.
CALMING_ALPHA_PER_S = 20.0
# Compiled code returns after about so long, for the progress and for whoever stops the run.
SECONDS_BETWEEN_RETURNS = 0.2
STEPS_BEFORE_TIMED = 16  # after which it is known how long a step takes
# For undamped bodies: steps between two checkpoints, the factor of the step after an inversion or too large a decrease of a
# corner's volume, and the share of the first step below which the step is not reduced for these reasons.
STEPS_BETWEEN_CHECKPOINTS = 50
SHORTENED_AFTER_FOLDING = 0.5
SHORTEST_SHARE_OF_FIRST_STEP = 1e-4
ROOM_BYTES = 16e6  # of samples that are kept before they are handed on


@dataclass(frozen=True)
class Status:
    """How a run ended: a state and, unless it finished, a sentence for the user with what to do."""

    state: str
    message: str = ""


def undamped(model: Model) -> bool:
    """Whether nothing damps the fastest vibrations of a body: little mass-proportional damping and no viscoelastic material."""
    return model.alpha_per_s < CALMING_ALPHA_PER_S and not any(effect.remembers for effect in model.effects)


def step_share(model: Model) -> float:
    """Ratio of the first automatic step to the stable limit."""
    return UNDAMPED_STEP_SHARE if undamped(model) else STEP_SHARE_OF_LIMIT


class Transient:
    """Advances a simulation to its end with the largest stable step.

    A Lanczos iteration estimates the stable limit. The step is 0.9 of it and divides the time to the next load edge into equal
    parts. It stays constant as long as possible: central differences conserve the energy at a constant step, and each change
    moves some energy between the highest vibrations. A stability check shortens the step if it exceeds 0.91 of the limit, and
    lengthens it if it has been below 0.82 of the smallest limit for 500 steps. A sample is taken at the first instant at or after
    its time and does not change the step.

    For a body without damping the step is 0.6 of the limit, and stays between 0.45 and 0.75. If the barrier against inversion is
    on, steps that turn out to be too long are taken back: the run continues from the last checkpoint with a shorter step. If the
    step were shortened while a corner is in the stiff part of the barrier and lengthened after it has left, the resulting changes
    of the energy would be biased and accumulate. A checkpoint is stored at each sample, at each load edge and every 50 steps, so
    the steps of such a body depend on the times of the samples.

    Parameters
    ----------
    simulation : at time 0.
    duration_s : simulated time, s; 1 microsecond to 1 hour.
    step_s : a fixed time step, s; the largest stable step if left out.

    Attributes
    ----------
    status : why the run cannot continue; None as long as it can.

    Raises
    ------
    InputError : a parameter out of range, or ``step_s`` above the stable limit.

    Examples
    --------
    >>> for sample in Transient(Simulation(model), duration_s=0.1).samples(every_s=0.01):
    ...     print(sample.time_s, sample.displacement.max())
    """

    def __init__(self, simulation: Simulation, duration_s: float, step_s: float | None = None) -> None:
        if not isinstance(simulation, Simulation):
            raise InputError(f"Transient: simulation must be a Simulation, not {shortened(repr(simulation))}.")
        duration_s = number_like("Transient: duration_s", duration_s, Positive, "duration_ms", 1e3)
        if step_s is not None:
            step_s = number_like("Transient: step_s", step_s, Positive, "step_us", 1e6)
        self.simulation = simulation
        self.duration_s = duration_s
        self.step_s = step_s
        self.status: Status | None = None
        edges = simulation.loads.edges_s
        self._marks = np.append(edges[(edges > 0.0) & (edges < duration_s * (1.0 - 1e-9))], duration_s)
        self._mark = 0
        self._left = 0  # steps to the next mark
        self._timed_steps = 0  # done here
        self._resumed = False
        calm = not undamped(simulation.model)
        self._share = step_share(simulation.model)
        self._longest = LONGEST_STEP_SHARE if calm else UNDAMPED_LONGEST_STEP_SHARE
        self._shortened = SHORTENED_STEP_SHARE if calm else UNDAMPED_STEP_SHARE
        self._looking = (AUTOMATIC_STEP if calm else UNDAMPED_STEP) if step_s is None else FIXED_STEP
        limit_s = simulation.stable_limit(TURNS_AT_THE_START)
        self._watch = simulation.lookers[0].watch
        self._watch[LIMIT] = self._watch[LOWEST_LIMIT] = limit_s
        simulation.watch(self._watch)
        simulation.see_elements()
        self.smallest_dt_s = np.inf
        self.largest_fraction = 0.0
        if step_s is not None and step_s > limit_s:
            number = simulation.limiting_element()
            raise InputError(
                f"analysis.step_us = {1e6 * step_s:g} (step_s in Python) is unstable: the largest stable step of this model is "
                f"{1e6 * limit_s:.4g} microseconds (determined by element {number}); reduce it or remove the key."
            )
        self._dt = 0.0
        self._divide(step_s or self._share * limit_s)
        self._first_dt = self._dt
        simulation.start(self._dt)
        self._checkpoint: dict[str, np.ndarray] | None = None
        has_barrier = simulation.blocks.barrier[:, MODULUS : MODULUS + 1].any()
        if self._looking == UNDAMPED_STEP and has_barrier and simulation.can_be_restored:
            self._checkpoint = self._state()

    @property
    def limit_s(self) -> float:
        """Stable limit of the step at the last stability check [s]."""
        return float(self._watch[LIMIT])

    @property
    def finished(self) -> bool:
        """Whether the simulation has reached ``duration_s``."""
        return self.simulation.time_s >= self.duration_s

    def advance_to(self, time_s: float) -> Status | None:
        """Advance to the first instant at or after a time.

        Parameters
        ----------
        time_s : s; at the end of the run at the latest.

        Returns
        -------
        Why the run cannot continue, or None.
        """
        time_s = finite_number("advance_to: time_s", time_s)
        target = min(time_s, self.duration_s)
        self._renew_checkpoint()  # the caller may have changed the state
        while self.status is None and self.simulation.time_s < target - 1e-6 * self._dt:
            self._go(self._steps_to(np.array([target]))[0])
        return self.status

    def recordings(self, every_s: float, room: int | None = None) -> Iterator[Recording]:
        """Advance to the end, and give the samples in batches.

        The first sample is the present state, except after :meth:`restore`. The others are the first instants at or after each
        multiple of ``every_s``. A batch has the samples of about 0.2 s of computing, and may be empty; the next batch overwrites
        it. If the run cannot continue, the last batch ends there, and ``status`` says why.

        Parameters
        ----------
        every_s : time between samples, s.
        room : the largest number of samples in a batch; as many as fit into 16 MB if left out.

        Raises
        ------
        InputError : ``every_s`` is not positive, or outside the limits of ``record.every_ms`` of a scenario.
        """
        return self._recordings(number_like("recordings: every_s", every_s, Positive, "every_ms", 1e3), room)

    def _recordings(self, every_s: float, room: int | None) -> Iterator[Recording]:
        simulation = self.simulation
        self._renew_checkpoint()  # the caller may have changed the state
        one = simulation.recording(1).arrays
        bytes_each = sum(
            array.nbytes for array in (one.displacement, one.velocity, one.J, one.hourglass, one.stress, one.pressure)
        )
        recording = simulation.recording(room or max(1, int(ROOM_BYTES / bytes_each)))
        if not self._resumed:
            simulation.go(0, simulation.dt_s, recording=recording, instants=np.zeros(1, dtype=np.int64))
        while True:
            begin = time.perf_counter()
            while self.status is None and not self.finished and recording.count < recording.room:
                now = simulation.time_s + 1e-6 * self._dt
                first = int(np.floor(now / every_s + 1e-9)) + 1
                asked = every_s * np.arange(first, first + recording.room - recording.count)
                asked = np.append(asked[asked < self.duration_s], self.duration_s)[: recording.room - recording.count]
                steps = np.unique(np.maximum(self._steps_to(asked), 1))
                self._go(int(steps[-1]), recording, steps)
                if time.perf_counter() - begin > SECONDS_BETWEEN_RETURNS:
                    break
            yield recording
            if self.status is not None or self.finished:
                return
            recording.clear()

    def samples(self, every_s: float) -> Iterator[Snapshot]:
        """Advance to the end, and give the samples one by one; the simulation is at the time of each.

        Parameters
        ----------
        every_s : time between samples, s.

        Yields
        ------
        Snapshots with ``time_s``, ``displacement`` (n, 3) m, ``velocity`` (n, 3) m/s, ``J`` (m,), ``energies`` [J] and more.

        Raises
        ------
        InputError : ``every_s`` is not positive, or outside the limits of ``record.every_ms`` of a scenario.
        RunError : the run cannot continue; the samples until then are valid.
        Stopped : a signal has asked to stop.
        """
        return self._samples(number_like("samples: every_s", every_s, Positive, "every_ms", 1e3))

    def _samples(self, every_s: float) -> Iterator[Snapshot]:
        for recording in self._recordings(every_s, room=1):
            for number in range(recording.count):
                yield recording[number]
                self._renew_checkpoint()  # the caller may have changed the state
        stopping.check()
        if self.status is not None:
            raise RunError(self.status.message)

    # ---- inside ----

    def _steps_to(self, times_s: np.ndarray) -> np.ndarray:
        """How many steps of the present length lead to the first instants at or after these times."""
        return np.ceil((times_s - self.simulation.time_s) / self._dt - 1e-6).astype(np.int64)

    def _go(self, steps: int, recording: Recording | None = None, instants: np.ndarray | None = None) -> None:
        """Advance by up to so many steps, with samples at ``instants``: to the next mark, to another step, or for a while."""
        simulation = self.simulation
        stop_signal = stopping.asked()
        if stop_signal is not None:
            self.status = Status(INTERRUPTED, f"{stopping.described(stop_signal)} at {1e3 * simulation.time_s:.3f} ms")
            return
        instants = np.zeros(0, dtype=np.int64) if instants is None else instants
        to_checkpoint = int(min([steps, self._left, *instants[:1]]))
        if self._checkpoint is not None:
            since = simulation.steps - int(self._checkpoint["steps"][0])
            steps = to_checkpoint = min(to_checkpoint, max(1, STEPS_BETWEEN_CHECKPOINTS - since))
        most = STEPS_BEFORE_TIMED
        if self._timed_steps >= STEPS_BEFORE_TIMED:
            most = max(most, int(SECONDS_BETWEEN_RETURNS * self._timed_steps / simulation.course_s))
        steps = min(int(steps), self._left, most)
        samples = 0 if recording is None else recording.count
        done = simulation.go(
            steps,
            self._dt,
            end_s=float(self._marks[self._mark]) if steps == self._left else None,
            looking=self._looking,
            recording=recording,
            instants=instants[instants <= steps],
        )
        self._left -= done
        self._timed_steps += done
        fell = done > 0 and self._looking == UNDAMPED_STEP and self._fall() > UNDAMPED_FALL_SHARE
        called = done < steps and not fell and self._watch[WAIT] > 0.0  # for another step, by a stability check
        if self._checkpoint is None:
            fell = fell and self._left > 0  # at a load edge there is another step anyway
        missing = recording is not None and recording.count - samples < np.searchsorted(instants, done, side="right")
        if recording is not None and missing and simulation.sound:  # it stopped at the instant of a sample, before that was taken
            simulation.go(0, simulation.dt_s, recording=recording, instants=np.zeros(1, dtype=np.int64))
        if self._step_was_too_long(fell, called):
            if recording is not None and self._checkpoint is not None:
                recording.count = samples
            return
        if self._left == 0:
            self._mark += 1  # a load changes here, and nothing is known of what follows
            self._watch[[WAIT, INTERVAL]] = FEWEST_STEPS_BETWEEN_SCANS
            if not self.finished:
                self._divide(self.step_s or self._share * self.limit_s)
        elif called:
            self._divide(self._share * self._watch[LOWEST_LIMIT])
        if done == to_checkpoint:
            self._renew_checkpoint()

    def _step_was_too_long(self, fell: bool, called: bool) -> bool:
        """Whether the last steps were too long; then shorten the step, or end the run.

        Parameters
        ----------
        fell : whether the volume of a corner decreased too much in the last step.
        called : whether a stability check has called for another step.
        """
        broken = not self.simulation.sound or not np.isfinite(self.limit_s)
        if broken or fell:
            shorter_s = SHORTENED_AFTER_FOLDING * self._dt
            shortest_s = SHORTEST_SHARE_OF_FIRST_STEP * self._first_dt
            if broken and (self._checkpoint is None or shorter_s < shortest_s):
                self.status = self._inverted()
                return True
            if shorter_s < shortest_s:
                return False
        elif called and self._dt > self._longest * self.limit_s:
            if self.step_s is not None:
                self.status = self._unstable(self.step_s)
                return True
            shorter_s = self._shortened * self.limit_s
        else:
            return False
        if self._checkpoint is None:
            self.largest_fraction = max(self.largest_fraction, self._dt / self.limit_s)
        else:
            self._continue_from(self._checkpoint)
        self._divide(shorter_s)
        return True

    def _fall(self) -> float:
        """How far the corner nearest to folding fell in the last step, as a share of what is left of it."""
        corners = [part.blocks.corner for part in self.simulation.parts]
        return max(float(corner[FALL] / max(corner[CORNER], 1e-300)) for corner in corners)

    def _divide(self, longest_s: float) -> None:
        """Equal steps, no longer than this, from here to the next mark."""
        time_left = self._marks[self._mark] - self.simulation.time_s
        self._left = max(1, int(np.ceil(time_left / longest_s - 1e-9)))
        self._dt = float(time_left / self._left)
        self.smallest_dt_s = min(self.smallest_dt_s, self._dt)
        self.largest_fraction = max(self.largest_fraction, self._dt / self.limit_s)
        self._watch[PERIOD], self._watch[LOWEST_LIMIT] = 0.0, self.limit_s
        self.simulation.watch(self._watch)

    def _unstable(self, step_s: float) -> Status:
        return Status(
            UNSTABLE,
            f"at {1e3 * self.simulation.time_s:.3f} ms the fixed step of {1e6 * step_s:g} microseconds has become "
            f"unstable: the tissue has stiffened and the stable limit is now {1e6 * self.limit_s:.4g} microseconds; "
            "remove analysis.step_us or reduce it.",
        )

    def _inverted(self) -> Status:
        simulation = self.simulation
        worst = simulation.broken_element()
        J = simulation.ledger[SMALLEST_J]
        x, y, z = 1e3 * simulation.model.mesh.points[simulation.model.mesh.hexes[worst]].mean(axis=0)
        folded = J > 0.0 and not simulation.ledger[SMALLEST_CORNER] > 0.0
        how = "inverted at a corner" if folded else f"inverted (J = {J:.3g})"
        return Status(
            INVERTED,
            f"at {1e3 * simulation.time_s:.3f} ms (step {simulation.steps}) element {worst} near "
            f"({x:.1f}, {y:.1f}, {z:.1f}) mm {how}: {self._why_inverted()}.",
        )

    def _why_inverted(self) -> str:
        """The probable cause, and what to do: the end of a sentence."""
        model = self.simulation.model
        on_nodes = bool(model.pulls) or any(load.of_muscle for load in model.loads)
        spread = ', spread the force (distribution = "stress")' if on_nodes else ""
        remedy = f"lower force_N{spread} or refine the mesh"
        if self.step_s is not None:
            return f"the fixed step is too long for this motion, or the forces are too large; reduce step_us, or {remedy}"
        if undamped(self.simulation.model):
            return (
                "the body has little damping, so that its fastest vibrations grow until elements invert; add model.damping "
                f"(alpha_per_s = 40 is usual), or {remedy}"
            )
        return f"the forces there are too large for the tissue, or the elements are too coarse; {remedy}"

    # ---- restart ----

    def restart_state(self, threads: int | None = None) -> dict[str, np.ndarray]:
        """Copies of the complete state, from which :meth:`restore` continues bitwise identically; see ``Simulation``.

        It is that of the last checkpoint where steps may be taken back, and otherwise the present one.

        ``threads``: number of threads for which sums are stored; that of the simulation if left out.
        """
        state = self._state() if self._checkpoint is None else {name: array.copy() for name, array in self._checkpoint.items()}
        return for_threads(state, threads or len(self.simulation.parts))

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Continue from a restart state of the same model."""
        self._resumed = True
        self._continue_from(state)
        self._renew_checkpoint()

    def _renew_checkpoint(self) -> None:
        """Take no step back beyond the present state; does nothing where none is taken back."""
        if self._checkpoint is not None and self.status is None:
            self._checkpoint = self._state()

    def _state(self) -> dict[str, np.ndarray]:
        return {
            "clock": np.array([self._dt, self.smallest_dt_s, self.largest_fraction]),
            "counters": np.array([self._mark, self._left], dtype=np.int64),
            **self.simulation.restart_state(),
        }

    def _continue_from(self, state: dict[str, np.ndarray]) -> None:
        self._dt, self.smallest_dt_s, self.largest_fraction = (float(x) for x in state["clock"])
        self._mark, self._left = (int(x) for x in state["counters"])
        self.simulation.restore(state)
