"""Tests under a tool by the simulator, with other numerics than a fit has: a quarter of the body, another mesh and tolerance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import PchipInterpolator

from explicitfe.fem.effects import EFFECTS, Effect, Measurement, physics_of, readings_of
from explicitfe.fem.effects.record import Record
from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.solve.equilibrium import Relaxation
from explicitfe.fem.solve.load_outcome import Stuck
from explicitfe.platform.errors import RunError
from explicitfe.simulate.anatomy.specimen import specimen_model
from studies.blind.closed_forms import Effects
from studies.blind.grid import Conditions
from studies.blind.protocols import FIRST_ROW_OF_HOLD_SHARE

POISSON_RATIO, DENSITY_KG_M3 = 0.499, 1040.0
FULLY_SAMPLED_WAIT_SHARE = (
    0.15  # A hold of this share of the curve's time, or longer, gets all its instants; a shorter one fewer.
)


@dataclass(frozen=True)
class MeshChoice:
    """How finely a test is simulated.

    Attributes
    ----------
    symmetry, refinement : keys of a scenario's specimen.
    tolerance : of the equilibrium.
    moving : instants from zero to the largest imposed value.
    waiting : instants of a long hold.
    """

    symmetry: str
    refinement: float
    tolerance: float
    moving: int
    waiting: int


DATA_MESH = MeshChoice("quarter", 0.5, 1.5e-4, 9, 4)
SCREENING_MESH = MeshChoice("sector", 0.4, 1e-3, 6, 3)  # differences of runs on one mesh


@dataclass(frozen=True, eq=False)
class SimulatedTest:
    """A curve under a tool, before noise is added to it.

    Attributes
    ----------
    specimen, tool : lengths [mm] as a dataset states them; tool_shape : its shape.
    corners : (time [s], displacement [mm] or force [N]) of the programme.
    by_force : whether the force is imposed, not the displacement.
    rows : times of the rows [s].
    test : number of the test. Curves of one test follow each other.
    """

    id: str
    specimen: Mapping[str, float]
    tool_shape: str
    tool: Mapping[str, float]
    corners: tuple[tuple[float, float], ...]
    by_force: bool
    rows: np.ndarray
    conditions: Conditions
    test: int
    split: str | None

    @property
    def imposed(self) -> np.ndarray:
        """Displacement [mm] or force [N] at the rows."""
        t, x = zip(*self.corners, strict=True)
        return np.interp(self.rows, t, x)

    def instants(self, numerics: MeshChoice, offset: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times [s] at which it is simulated, what is imposed then, and which of them are corners.

        ``offset`` is added to what is imposed; where it then passes 0, contact begins or ends.
        """
        t, x = (np.array(column, dtype=float) for column in zip(*self.corners, strict=True))
        x = x + offset
        for k in reversed(range(len(t) - 1)):
            if x[k] * x[k + 1] < 0.0:
                t = np.insert(t, k + 1, t[k] + (t[k + 1] - t[k]) * x[k] / (x[k] - x[k + 1]))
                x = np.insert(x, k + 1, 0.0)
        times, corners = [t[:1]], [0]
        largest = np.abs(x).max()
        for k in range(len(t) - 1):
            share_moved = abs(x[k + 1] - x[k]) / largest
            if share_moved > 0.0:
                count = max(int(np.ceil(numerics.moving * share_moved)), 1)
                share = np.arange(1, count + 1) / count
            else:
                wait = (t[k + 1] - t[k]) / (t[-1] - t[0])
                count = max(round(numerics.waiting * min(wait / FULLY_SAMPLED_WAIT_SHARE, 1.0)), 1)
                first = FIRST_ROW_OF_HOLD_SHARE
                share = np.expm1(np.arange(1, count + 1) / count * np.log1p(1.0 / first)) * first
            times.append(t[k] + share * (t[k + 1] - t[k]))
            corners.append(corners[-1] + len(share))
        at = np.concatenate(times)
        return at, np.interp(at, t, x), np.array(corners)


def simulate(
    curves: Sequence[SimulatedTest], constants: tuple[float, float], effects: Effects, numerics: MeshChoice
) -> list[np.ndarray]:
    """The reading at the rows of each curve (k,): force [N], or displacement [m] where the force is imposed.

    Raises
    ------
    RunError : a state is not reached.
    """
    known = [EFFECTS[name](**parameters) for name, parameters in effects.items()]
    readings, physics = readings_of(known), physics_of(known)
    waits = any(effect.transient for effect in physics)
    answers = []
    for number in dict.fromkeys(curve.test for curve in curves):
        test = [curve for curve in curves if curve.test == number]
        body = _body(test[0], constants, physics, numerics)
        start = 0.0
        for k, curve in enumerate(test):
            answers.append(_curve(body, curve, readings, numerics, start, waits))
            following = test[k + 1] if k + 1 < len(test) else curve
            start += float(curve.rows[-1] + following.rows[1])
    return answers


def _body(curve: SimulatedTest, constants: tuple[float, float], physics: Sequence[Effect], numerics: MeshChoice) -> Relaxation:
    material = {"law": "yeoh", "C10_Pa": constants[0], "C20_Pa": constants[1]}
    specimen = SpecimenTable(
        symmetry=numerics.symmetry,
        refinement=numerics.refinement,
        material=material | {"poisson": POISSON_RATIO, "density_kg_m3": DENSITY_KG_M3},
        **curve.specimen,
    )
    tool = ToolTable(shape=curve.tool_shape, **curve.tool)
    body = Relaxation(specimen_model(specimen, tool, physics), numerics.tolerance, threads=1)
    body.compile()
    if isinstance(body.settle(), Stuck):
        raise RunError("the specimen does not reach equilibrium.")
    return body


def _curve(
    body: Relaxation, curve: SimulatedTest, readings: Sequence[Measurement], numerics: MeshChoice, start_s: float, waits: bool
) -> np.ndarray:
    """One curve of a test, from the state where the last one ended; ``waits``: something happens while nothing moves."""
    offset, record = 0.0, Record("force-displacement", curve.rows, np.zeros(len(curve.rows)))
    if not curve.by_force:
        offset = 1e3 * sum(float(effect.true_motion(np.zeros(1), record)[0]) for effect in readings)
    at, imposed, corners = curve.instants(numerics, offset)
    answers = np.zeros(len(at))
    for k, (t, x) in enumerate(zip(at, imposed, strict=True)):
        if k == 0 and x == 0.0 and start_s == 0.0:
            continue  # The tool just touches.
        if k > 0 and x == imposed[k - 1] and not waits:
            answers[k] = answers[k - 1]
            continue
        reached = body.press(x, at_s=start_s + t) if curve.by_force else body.move(1e-3 * x, at_s=start_s + t)
        if isinstance(reached, Stuck):
            raise RunError(f"{curve.id}: {reached.reason} at {t:.3g} s.")
        answers[k] = reached.displacement_m if curve.by_force else reached.force_N
    values = np.empty(len(curve.rows))
    for start, end in pairwise(corners):
        inside = (curve.rows >= at[start] - 1e-9) & (curve.rows <= at[end] + 1e-9)
        t, y = at[start : end + 1], answers[start : end + 1]
        rows = np.clip(curve.rows[inside], t[0], t[-1])
        values[inside] = PchipInterpolator(t, y)(rows) if len(t) > 2 else np.interp(rows, t, y)
    for effect in readings:
        values = effect.read_motion(values, record) if curve.by_force else effect.read_load(values, record)
    return values
