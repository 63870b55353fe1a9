"""A test under a tool: between platens by the law itself where the state is homogeneous, else by the simulator."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from explicitfe.fem.effects import Effect
from explicitfe.fem.effects.effect import physics_of, readings_of
from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve.equilibrium import Relaxation
from explicitfe.fem.solve.load_outcome import Stuck
from explicitfe.fem.solve.revolution import Revolution, ToolState
from explicitfe.inverse.measured.contact import CONTACT_POWERS
from explicitfe.inverse.measured.course import Course, course_of
from explicitfe.inverse.measured.curve import Curve, programme_of, sd_of
from explicitfe.inverse.predict.experiment import CurveAnswer, start_times
from explicitfe.inverse.predict.platens import STEPS_TO_LOSS_OF_CONTACT, Platens
from explicitfe.inverse.predict.reading import reading, true_programme
from explicitfe.inverse.predict.setup import SpecimenKeys, is_uniform, setup_of
from explicitfe.inverse.predict.tissue import Numerics
from explicitfe.platform.errors import RunError
from explicitfe.simulate.anatomy.specimen import specimen_model

# A tool may lose contact in the next step if 1.2 times the fall of the force in the last step would bring it to zero: 20 % more
# is on the safe side.
FALL_MARGIN_FACTOR = 1.2
# The force of a tool falls to zero with this power of the depth (Hertz's for a sphere); that of a flat tool falls linearly.
# Newton's method may fail where soft tissue snaps over a sharp edge. It then tries a section whose elements pass it elsewhere.
SECTION_SHARES = (1.0, 0.85)
# A test is given up when its loads need more iterations than this on average, so that its cost has a bound. At the usual numerics
# they need 700 to 3000, at a Poisson's ratio of 0.4999 about 5000.
MOST_MEAN_ITERATIONS = 30_000


def time_matters(effects: Sequence[Effect]) -> bool:
    """Whether anything happens in a specimen while the tool waits; a specimen has no muscles."""
    return any(effect.transient and effect.acts_on != "muscle" for effect in effects)


def is_homogeneous(curve: Curve, physics: Sequence[Effect]) -> bool:
    """Whether a test with a tool needs no mesh: every point of the specimen is strained alike."""
    assert curve.tool is not None
    uniform = curve.tool.control == "displacement" and all(effect.pointwise for effect in physics)
    return uniform and is_uniform(setup_of(curve, 0.0, 1.0))


def course_of_test(
    test: Sequence[Curve], effects: Sequence[Effect], density: float
) -> tuple[Course, np.ndarray, np.ndarray, float | None]:
    """What a tool really does in a test.

    Returns
    -------
    course : the instants that are computed.
    time_s, programme : (k,) all rows of the curves one after the other, and what is really imposed there.
    contact_power : see :meth:`Course.at`; None where the tool cannot lose contact or a force is imposed.
    """
    first = test[0]
    assert first.tool is not None
    by_force = first.imposed == "force_N"
    readings, physics = readings_of(effects), physics_of(effects)
    time_s = np.concatenate([curve.time_s + start for curve, start in zip(test, start_times(test), strict=True)])
    programme = np.concatenate([true_programme(programme_of(curve), curve, readings, by_force) for curve in test])
    tied = first.tool.shape == "bonded-disc"
    sd = sd_of(first, first.imposed) or 0.0
    contact_power = None if by_force or tied else CONTACT_POWERS.get(first.tool.shape, 1.0)
    course = course_of(time_s, programme, sd=sd, waits=time_matters(physics), density=density, touches=not tied)
    return course, time_s, programme, contact_power


def predict_under_a_tool(
    test: Sequence[Curve],
    law: Yeoh,
    homogeneous_law: Yeoh,
    effects: Sequence[Effect],
    numerics: Numerics,
    corrected: Callable[[np.ndarray, np.ndarray, bool], np.ndarray] | None = None,
    keeps_volume: bool = True,
    variants: Sequence[tuple[Yeoh, Sequence[Effect]]] = (),
) -> list[CurveAnswer]:
    """Predict the curves of a test with a tool.

    Parameters
    ----------
    law, homogeneous_law : the elastic law in elements, and in a homogeneous state between platens.
    corrected : (answer, true programme, whether the force is imposed) -> what a finer mesh would answer.
    keeps_volume : the volume of the tissue does not change, where the section of a body of revolution is solved.
    variants : laws and effects of tissues that differ by little, which are computed beside this one there.

    Raises
    ------
    RunError : a state is not reached.
    """
    begin = time.perf_counter()
    first = test[0]
    assert first.specimen is not None and first.tool is not None
    by_force = first.imposed == "force_N"
    physics = physics_of(effects)
    setup = setup_of(first, law.poisson, numerics.refinement)
    course, time_s, programme, contact_power = course_of_test(test, effects, numerics.density)
    uniform = is_homogeneous(first, physics)
    iterations = 0
    if uniform:
        platens = Platens.of(homogeneous_law, physics, 1e-3 * first.specimen.thickness_mm, 1e-6 * first.specimen.face_mm2)
        try:
            course, answers, loses_contact = platens.follow(course)
            contact_power = contact_power if loses_contact else None
        except RunError:  # The simulator takes smaller steps and may get there.
            uniform = False
    of_variants: list[np.ndarray | None] = [None] * len(variants)
    in_section = not uniform and numerics.section > 0.0 and all(effect.in_revolution for effect in physics)
    if in_section:
        specimen, tool = as_cylinder(setup.specimen, law), ToolTable.model_validate(setup.tool)
        others = [(one, physics_of(own)) for one, own in variants]
        few = _at_few_rows(course, time_s, programme)
        for share in SECTION_SHARES:
            section = Revolution(specimen, tool, law, physics, share * numerics.section, keeps_volume, others)
            try:
                driven = _drive(section, few, by_force, contact_power is not None, first.id)
            except RunError:
                # Where a platen presses a specimen flat, its side folds onto the platen, which relaxation can follow.
                in_section = share != SECTION_SHARES[-1]
                if in_section or first.tool.shape == "platen":
                    continue
                raise
            course, answers, iterations, columns = driven
            of_variants = [None if np.isnan(column).any() else column for column in columns.T]
            break
    if not uniform and not in_section:
        symmetry = setup.specimen["symmetry"]
        if symmetry == "sector" and any(effect.breaks_symmetry for effect in physics):
            symmetry = "quarter"
        specimen = SpecimenTable.model_validate({**setup.specimen, "symmetry": symmetry, "material": law.model_dump()})
        tool = ToolTable.model_validate(setup.tool)
        # Tests are shared out among processes, so each has one thread: a prediction must not depend on the number of cores.
        body = Relaxation(specimen_model(specimen, tool, physics), numerics.tolerance, threads=1)
        body.compile()
        course, answers, iterations, _ = _drive(body, course, by_force, contact_power is not None, first.id)
    # On one ramp of the section nothing ripples, slips or softens.
    smooth = in_section and not any(effect.depends_on_path for effect in physics)
    power = None if smooth and len(course.bends) == 2 else contact_power
    at_rows = [None if one is None else course.at(one, time_s, power, smooth=smooth) for one in (answers, *of_variants)]
    if corrected is not None and not uniform:
        at_rows = [None if one is None else corrected(one, programme, by_force) for one in at_rows]
    seconds = (time.perf_counter() - begin) / len(test)
    instants, iterations_of_each = len(course.time_s) // len(test), iterations // len(test)
    ends = np.cumsum([len(curve.time_s) for curve in test])[:-1]
    kinds = [readings_of(effects), *(readings_of(others) for _, others in variants)]
    read: list[Sequence[np.ndarray | None]] = [
        [None] * len(test) if true is None else reading(np.split(true, ends), test, its, by_force)
        for true, its in zip(at_rows, kinds, strict=True)
    ]
    predictions = []
    for values, *others in zip(*read, strict=True):
        assert values is not None
        predictions.append(CurveAnswer(values, instants, iterations_of_each, seconds, setup.assumed, variants=tuple(others)))
    return predictions


def _at_few_rows(course: Course, time_s: np.ndarray, programme: np.ndarray) -> Course:
    """The course, or where rows (k,) are fewer than its instants the rows themselves: nothing is interpolated then."""
    before = course.time_s < time_s[0]
    if len(time_s) + np.count_nonzero(before) >= len(course.time_s):
        return course
    instants = np.concatenate([course.time_s[before], time_s])
    return Course(instants, np.concatenate([course.imposed[before], programme]), np.array([0, len(instants) - 1]))


def as_cylinder(keys: SpecimenKeys, law: Yeoh) -> SpecimenTable:
    """The specimen, or instead of a block a cylinder with the same face; corrections make up for the difference."""
    own: dict[str, object] = dict(keys)
    size = own.pop("size_mm", None)
    if size is not None:
        own |= {"radius_mm": float(np.sqrt(size[0] * size[1] / np.pi)), "height_mm": size[2]}  # type: ignore[index]
    return SpecimenTable.model_validate({**own, "symmetry": "sector", "material": law.model_dump()})


def _drive(
    body: Relaxation | Revolution,
    course: Course,
    by_force: bool,
    loses_contact: bool,
    name: str,
) -> tuple[Course, np.ndarray, int, np.ndarray]:
    """Impose a course on a body.

    Returns
    -------
    course : finer than the given one where the tool loses contact.
    answers : force [N] or displacement [m] at its instants.
    iterations : of dynamic relaxation.
    variants : (n, v) answers of the variants of a body of revolution; NaN where one was lost.
    """
    settled = body.settle()
    if isinstance(settled, Stuck):
        raise RunError(f'curve "{name}": the body does not come to rest before the tool moves.')
    answers: list[float] = []
    variants: list[list[float]] = []
    iterations = settled.iterations
    push = body.press if by_force else body.move
    number = finer_until = 0
    while number < len(course.time_s):
        if loses_contact and number > max(1, finer_until) and _may_lose_contact(answers, course, number):
            course = course.split(number, STEPS_TO_LOSS_OF_CONTACT)
            finer_until = number + STEPS_TO_LOSS_OF_CONTACT
        t, x = course.time_s[number], course.imposed[number]
        # Until a tool that is not bonded touches, the body is at rest.
        idle = not any(answers) and (x <= 0.0 if loses_contact else x == 0.0 and not answers)
        reached = settled if idle else push(float(x), at_s=float(t - course.time_s[0]))
        if isinstance(reached, Stuck):
            raise RunError(f'curve "{name}": {_reason_of(reached, float(x), float(t), by_force)}')
        iterations += reached.iterations
        if iterations > MOST_MEAN_ITERATIONS * len(course.time_s):
            raise RunError(
                f'curve "{name}": given up at {t:.4g} s after {iterations} iterations for {number + 1} of {len(course.time_s)} '
                "instants: with these constants and effects the body is barely stable, or nearly incompressible. "
                "Use stiffer constants, a smaller Poisson's ratio or a smaller refinement."
            )
        answers.append(reached.displacement_m if by_force else reached.force_N)
        beside = reached.variants if isinstance(reached, ToolState) else ()
        variants.append([np.nan if one is None else one[by_force] for one in beside])
        number += 1
    return course, np.array(answers), iterations, np.array(variants).reshape(len(answers), -1)


def _reason_of(stuck: Stuck, goal: float, time_s: float, by_force: bool) -> str:
    """Which load was not reached, why, and what to change."""
    unit, factor = ("N", 1.0) if by_force else ("mm", 1e3)
    x, y, z = 1e3 * stuck.place_m
    if stuck.reason == "inverted":
        why = f"an element near ({x:.1f}, {y:.1f}, {z:.1f}) mm is inverted"
    else:
        why = f"the nodal forces do not converge (relative residual {stuck.residual:.2g})"
    advice = (
        "The tissue may be too soft for this force: use stiffer constants, or another refinement."
        if by_force
        else "The tissue may be too deformed under the tool: check the displacement, or use another refinement."
    )
    reached = f"the last converged load is {factor * stuck.reached:.4g} {unit}"
    return f"no equilibrium at {factor * goal:.4g} {unit}, {time_s:.4g} s: {why}; {reached}. {advice}"


def _may_lose_contact(force_N: Sequence[float], course: Course, number: int) -> bool:
    """Whether the tool may lose contact on the step to an instant, by the line through the last two."""
    before, last = force_N[number - 2], force_N[number - 1]
    pace = (before - last) / (course.time_s[number - 1] - course.time_s[number - 2])
    return 0.0 < last <= pace * (course.time_s[number] - course.time_s[number - 1]) * FALL_MARGIN_FACTOR
