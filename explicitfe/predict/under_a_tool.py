"""A test under a tool: between platens by the law itself where the state is homogeneous, else by the simulator."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from explicitfe.effects import Effect, MaterialEffect, Measurement
from explicitfe.effects.material.fibres import Fibres
from explicitfe.errors import RunError
from explicitfe.materials.yeoh import Yeoh
from explicitfe.measured.course import Course, course_of
from explicitfe.measured.curve import Curve, programme_of, sd_of
from explicitfe.model.specimen import specimen_model
from explicitfe.predict.experiment import CurveAnswer, start_times
from explicitfe.predict.platens import UNIFORM, Platens
from explicitfe.predict.reading import reading, true_programme
from explicitfe.predict.setup import is_uniform, setup_of
from explicitfe.predict.tissue import Numerics
from explicitfe.scenario.indentation import SpecimenTable, ToolTable
from explicitfe.solve.equilibrium import Relaxation, Stuck

CAREFUL, EARLY = 4, 1.2  # parts of the step in which a tool may lose contact; it may if 1.2 times the last fall would do


LIFTS = {"sphere": 1.5}  # power of the way with which the force of a tool falls to nothing; 1 for flat ones


def has_waits(effects: Sequence[Effect]) -> bool:
    """Whether anything happens to the material while nothing moves."""
    return any(isinstance(effect, MaterialEffect) and effect.values(1.0) != effect.values(0.0) for effect in effects)


def predict_under_a_tool(
    test: Sequence[Curve],
    law: Yeoh,
    effects: Sequence[Effect],
    numerics: Numerics,
    progress: Callable[[float], None],
) -> list[CurveAnswer]:
    begin = time.perf_counter()
    first = test[0]
    by_force = first.imposed == "force_N"
    readings = [effect for effect in effects if isinstance(effect, Measurement)]
    physics = [effect for effect in effects if not isinstance(effect, Measurement)]
    setup = setup_of(first, law.poisson, numerics.refinement)
    time_s = np.concatenate([curve.time_s + start for curve, start in zip(test, start_times(test), strict=True)])
    way = np.concatenate([true_programme(programme_of(curve), curve, readings, by_force) for curve in test])
    tied = first.tool.shape == "bonded-disc"
    uniform = is_uniform(setup) and not by_force and all(isinstance(effect, UNIFORM) for effect in physics)
    sd = sd_of(first, first.imposed) or 0.0
    lifts = None if by_force or tied else LIFTS.get(first.tool.shape, 1.0)
    course = course_of(time_s, way, sd=sd, waits=has_waits(physics), density=numerics.density, touches=not tied)
    iterations = 0
    if uniform:
        size = first.specimen
        made = Platens.of(law, physics, 1e-3 * size.thickness_mm, 1e-6 * size.face_mm2)
        try:
            course, answers, lost = made.followed(course)
            lifts = lifts if lost else None
        except RunError:  # the simulator gets there by smaller steps
            uniform = False
    if not uniform:
        data = dict(setup.specimen)
        if data["symmetry"] == "sector" and any(isinstance(e, Fibres) and any(e.direction[:2]) for e in physics):
            data["symmetry"] = "quarter"
        specimen = SpecimenTable(**data, material=law.model_dump())
        # One thread: tests are shared out among processes, and what is predicted does not depend on the machine's cores.
        body = Relaxation(specimen_model(specimen, ToolTable(**setup.tool), physics), numerics.tolerance, threads=1)
        body.compile()
        course, answers, iterations = _driven(body, course, by_force, lifts is not None, first.id, progress)
    values = course.at(answers, time_s, lifts)
    seconds = (time.perf_counter() - begin) / len(test)
    found = []
    for curve in test:
        mine, values = values[: len(curve.time_s)], values[len(curve.time_s) :]
        instants, shared = len(course.time_s) // len(test), iterations // len(test)
        found.append(CurveAnswer(reading(mine, curve, readings, by_force), instants, shared, seconds, setup.assumed))
    return found


def _driven(
    body: Relaxation, course: Course, by_force: bool, lifts: bool, name: str, progress: Callable[[float], None]
) -> tuple[Course, np.ndarray, int]:
    """The course, finer where the tool loses contact; force [N] or displacement [m] at its instants; iterations that took."""
    rest = body.settle()
    if isinstance(rest, Stuck):
        raise RunError(f'curve "{name}": the body does not come to rest before the tool moves.')
    answers: list[float] = []
    total = rest.iterations
    push = body.press if by_force else body.move
    number = cut = 0
    while number < len(course.time_s):
        if lifts and number > max(1, cut) and _leaves(answers, course, number):
            course, cut = course.split(number, CAREFUL), number + CAREFUL
        t, x = course.time_s[number], course.imposed[number]
        # until a tool that does not stick touches, the body is at rest
        idle = not any(answers) and (x <= 0.0 if lifts else x == 0.0 and not answers)
        reached = rest if idle else push(float(x), at_s=float(t - course.time_s[0]))
        if isinstance(reached, Stuck):
            unit, factor = ("N", 1.0) if by_force else ("mm", 1e3)
            place = ", ".join(f"{1e3 * c:.3g}" for c in reached.place_m)
            raise RunError(
                f'curve "{name}": the model stops at {factor * reached.reached:.3g} {unit} of {factor * x:.3g} {unit}, '
                f"{t:.3g} s ({reached.reason} at {place} mm); take another refinement."
            )
        total += reached.iterations
        answers.append(reached.displacement_m if by_force else reached.force_N)
        number += 1
        progress(number / len(course.time_s))
    return course, np.array(answers), total


def _leaves(force_N: Sequence[float], course: Course, number: int) -> bool:
    """Whether the tool may lose contact on the step to an instant, by the line through the last two."""
    before, last = force_N[number - 2], force_N[number - 1]
    pace = (before - last) / (course.time_s[number - 1] - course.time_s[number - 2])
    return 0.0 < last <= pace * (course.time_s[number] - course.time_s[number - 1]) * EARLY
