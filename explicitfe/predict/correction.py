"""What a finer mesh would answer: a coarse run corrected by a factor of the depth, read off a few elastic ramps.

Where the tool's edge passes the nodes of a mesh, the force ripples with the depth. This error and the stiffness that a mesh adds
depend on where the surface is, hardly on time and little on the constants. The ratio of the answers of a fine and of a coarse
mesh to one ramp therefore corrects any course of the same test. Where a tissue remembers, the ripple of earlier depths is left in
its memory: there each test is followed on the coarse mesh and on a finer one, and the ratio of these answers to what the ramps
foretell of it is a factor of each row.

What the fine mesh itself leaves is smooth in the depth. It falls with the square of the size of the elements, and is extrapolated
from two fine meshes (Richardson 1911). An edge that is stated as sharp is computed with two radii of rounding and extrapolated to
none, since the force is linear in a small radius.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from explicitfe.effects import Measurement, physics_of, readings_of
from explicitfe.measured.curve import Curve, programme_of
from explicitfe.predict.experiment import experiments
from explicitfe.predict.reading import as_it_is, true_programme
from explicitfe.predict.setup import RADIUS_OVER_SHARP_EDGE
from explicitfe.predict.tissue import Numerics, Tissue
from explicitfe.predict.under_a_tool import is_homogeneous

# Rows of a ramp: between two of them an answer is nearly straight.
RAMP_ROWS = 49
# Numbers of instants and the tolerance of the fine ramps.
FINE_DENSITY, FINE_TOLERANCE = 1.5, 2e-4
# Ratio of the two fine meshes, and the power of the element size with which their error falls.
MESH_RATIO, MESH_ORDER = 1.5, 2.0
# A body without rotational symmetry has so many elements that its ramps are no finer than this.
FINEST_IN_SPACE = 1.0
# What the two fine meshes differ by is smooth in the depth: a polynomial of this degree. What it leaves is ripple.
SMOOTH_DEGREE = 2
# Of the extrapolated step 1.25 times is a bound in 95 of 100 cases where a mesh was refined twice (Roache 1994): two standard
# deviations.
ERROR_SHARE_OF_STEP = 0.625
# The step from a rounded edge to a sharp one is linear in the radius to a tenth. But an edge that is called sharp is broken by
# some tenth of a millimetre where it was machined: of a tool of 12 mm that is 0.3 of the step from its 28th part, one standard
# deviation.
ERROR_SHARE_OF_EDGE = 0.3
# What a tissue remembers of a mesh's ripple has mostly cancelled, while the factor undoes all of it at the depth of now. About so
# much of the force of a tissue that relaxes is what it remembers; of the ripple of the finer mesh it is an error.
REMEMBERED_SHARE = 0.3
# Where an answer is a smaller share of the largest one, its ratio to another says nothing.
LEAST_COMPARED_SHARE = 0.02
RIPPLE_IN_MEMORY = "ripple in history-dependent stress"
# Ripple may add to the answer any smooth curve up to this degree of the depth.
RIPPLE_DEGREE = 3

Job = tuple[tuple[Curve, ...], str]  # a test, and the text of a tissue
Run = list[np.ndarray] | str  # what each curve of the test answers in SI, or why it cannot be computed


@dataclass(frozen=True, eq=False)
class Correction:
    """The factor of a coarse answer as a function of the depth, with its errors.

    Attributes
    ----------
    depth_m : (m,) depths of the tool in the coarse run, increasing.
    factor : (m,) fine answer over coarse answer.
    errors : name -> (m,) one standard deviation of the factor's relative error; the errors are independent of each other.
        ``RIPPLE_IN_MEMORY`` is there only where a tissue remembers.
    remembered : curve -> (k,) a further factor of its rows, where a tissue remembers.
    """

    depth_m: np.ndarray
    factor: np.ndarray
    errors: Mapping[str, np.ndarray]
    remembered: Mapping[str, np.ndarray] = field(default_factory=dict)

    def applied(self, answer: np.ndarray, programme: np.ndarray, by_force: bool, followed: Sequence[Curve] = ()) -> np.ndarray:
        """A coarse answer (k,) to a true programme (k,), corrected.

        Parameters
        ----------
        followed : curves whose own courses the answer follows, row by row, one after the other.
        """
        corrected = answer * self._at(self.factor, answer, programme, by_force)
        if followed and all(curve.id in self.remembered for curve in followed):
            corrected = corrected * np.concatenate([self.remembered[curve.id] for curve in followed])
        return corrected

    def error_of(self, name: str, answer: np.ndarray, programme: np.ndarray, by_force: bool) -> np.ndarray:
        """One of the errors as a share of the answer (k,)."""
        return self._at(self.errors[name], answer, programme, by_force)

    def _at(self, column: np.ndarray, answer: np.ndarray, programme: np.ndarray, by_force: bool) -> np.ndarray:
        return np.interp(answer if by_force else programme, self.depth_m, column)


def corrections_of(tissue: Tissue, curves: Sequence[Curve], run: Callable[[list[Job]], list[Run]]) -> dict[str, Correction]:
    """Curve -> the correction of its answer; none where no mesh is needed or the fine ramps cannot be computed.

    Parameters
    ----------
    tissue : with ``numerics.finer`` above 0, else nothing is corrected.
    curves : those that are asked for; tests of one kind share their ramps, down to the largest depth of them.
    run : computes tests.
    """
    plain = _without_memory(tissue)
    kinds: dict[str, list[Curve]] = {}
    for test in experiments(curves):
        physics = physics_of(tissue.effects.chosen)
        if tissue.numerics.finer > 0.0 and test[0].tool is not None and not is_homogeneous(test[0], physics):
            kinds.setdefault(kind_of(test[0]), []).extend(test)
    ladders = {
        kind: _ladder(ramp_of(alike[0], alike, readings_of(tissue.effects.chosen)), plain) for kind, alike in kinds.items()
    }
    remembers = any(effect.remembers for effect in tissue.effects.chosen)
    histories = {kind: _histories(tissue, alike) if remembers else [] for kind, alike in kinds.items()}
    runs = iter(run([job for kind, ladder in ladders.items() for job in [*ladder, *histories[kind]]]))
    by_curve: dict[str, Correction] = {}
    for kind, ladder in ladders.items():
        answers = [answer[0] for answer in (next(runs) for _ in ladder) if not isinstance(answer, str)]
        followed = [next(runs) for _ in histories[kind]]
        if len(answers) < len(ladder):
            continue
        ramp = ladder[0][0][0]
        correction = _correction(ramp, answers, tissue.numerics if remembers else None)
        correction = replace(correction, remembered=_remembered(ramp, answers, histories[kind], followed))
        by_curve |= {curve.id: correction for curve in kinds[kind]}
    return by_curve


def _histories(tissue: Tissue, alike: Sequence[Curve]) -> list[Job]:
    """Each test as it really is, on the usual mesh and then on the finer one with which ratios in its memory are known."""
    readings = readings_of(tissue.effects.chosen)
    tissue = tissue.model_copy(update={"effects": tissue.effects.without(readings)})
    finer = {"refinement": _finest(alike[0], tissue.numerics) / MESH_RATIO, "tolerance": FINE_TOLERANCE}
    texts = [tissue.text, tissue.model_copy(update={"numerics": tissue.numerics.model_copy(update=finer)}).text]
    return [(tuple(as_it_is(curve, readings) for curve in test), text) for test in experiments(alike) for text in texts]


def _remembered(
    ramp: Curve, answers: Sequence[np.ndarray], histories: Sequence[Job], followed: Sequence[Run]
) -> dict[str, np.ndarray]:
    """Curve -> what a finer mesh changes in its rows over what it changes in a ramp at the same depth."""
    by_force = ramp.imposed == "force_N"
    programme, (usual, _, between, *_) = programme_of(ramp), answers
    pressed = (usual > 0.0) & (between > 0.0) & (programme > 0.0)
    depth = np.maximum.accumulate(usual if by_force else programme)[pressed]
    changed = between[pressed] / usual[pressed]
    factors: dict[str, np.ndarray] = {}
    for (test, _), coarse, finer in zip(histories[::2], followed[::2], followed[1::2], strict=True):
        if isinstance(coarse, str) or isinstance(finer, str):
            continue
        for curve, one, other in zip(test, coarse, finer, strict=True):
            foretold = np.interp(one if by_force else programme_of(curve), depth, changed)
            compared = np.minimum(one, other) > LEAST_COMPARED_SHARE * one.max(initial=0.0)
            factors[curve.id] = np.where(compared, other / np.where(compared, one, 1.0) / foretold, 1.0)
    return factors


def ramp_of(first: Curve, alike: Sequence[Curve], readings: Sequence[Measurement]) -> Curve:
    """One ramp off which all courses of a kind of test can be read, without what a machine misreads."""
    assert first.tool is not None
    by_force = first.tool.control == "force"
    top = max(float(true_programme(programme_of(c), c, readings, by_force).max()) for c in alike)
    share = np.linspace(0.0, 1.0, RAMP_ROWS)
    guess = max(float(np.abs(c.columns[first.predicted]).max()) for c in alike)
    columns = {first.imposed: share * top, first.predicted: share * guess}
    return replace(first, time_s=share, columns={name: columns[name] for name in first.columns})


@lru_cache(maxsize=10_000)
def kind_of(curve: Curve) -> str:
    """Equal for tests that differ in their course only."""
    known = [curve.conditions.get(key) for key in ("preload_N", "direction")]
    return f"{curve.specimen!r} {curve.tool!r} {curve.constants} {known}"


def _without_memory(tissue: Tissue) -> Tissue:
    """The tissue as an elastic ramp shows it on a body with all its symmetry, without readings."""
    dropped = tuple(
        effect
        for effect in tissue.effects.chosen
        if effect.acts_on == "reading" or effect.remembers or effect.needs_half_body or effect.breaks_symmetry
    )
    return tissue.model_copy(update={"effects": tissue.effects.without(dropped)})


def _ladder(ramp: Curve, tissue: Tissue) -> list[Job]:
    """The ramp on the usual mesh, on a fine one and on one between them; with a sharp edge also with twice the rounding."""
    assert ramp.specimen is not None and ramp.tool is not None
    usual = tissue.numerics
    finest = _finest(ramp, usual)
    fine, between = (
        Numerics(refinement=finest / ratio, density=FINE_DENSITY, tolerance=FINE_TOLERANCE) for ratio in (1.0, MESH_RATIO)
    )
    texts = [
        tissue.model_copy(update={"numerics": numerics}).text
        for numerics in (usual.model_copy(update={"finer": 0.0}), fine, between)
    ]
    jobs: list[Job] = [((ramp,), text) for text in texts]
    if _is_sharp(ramp):
        assert ramp.tool.radius_mm is not None
        rounded = ramp.tool.model_copy(update={"edge_radius_mm": 2.0 * ramp.tool.radius_mm / RADIUS_OVER_SHARP_EDGE})
        jobs.append(((replace(ramp, tool=rounded),), texts[1]))
    return jobs


def _finest(curve: Curve, numerics: Numerics) -> float:
    """Refinement of the finest mesh."""
    assert curve.specimen is not None
    return numerics.finer if curve.specimen.size_mm is None else min(numerics.finer, FINEST_IN_SPACE)


def _is_sharp(curve: Curve) -> bool:
    assert curve.tool is not None
    return curve.tool.shape == "flat-cylinder" and curve.tool.edge_radius_mm == 0.0


def _correction(ramp: Curve, answers: Sequence[np.ndarray], remembering: Numerics | None) -> Correction:
    """The correction from the answers (RAMP_ROWS,) to a ladder of ramps; with numerics, for a tissue that remembers."""
    by_force = ramp.imposed == "force_N"
    programme = programme_of(ramp)
    pressed = np.all([answer > 0.0 for answer in answers], axis=0) & (programme > 0.0)
    if not pressed.any():
        return Correction(np.zeros(1), np.ones(1), {})
    usual, fine, between = (answer[pressed] for answer in answers[:3])
    depth = usual if by_force else programme[pressed]
    share = depth / depth[-1]
    change = (fine - between) / fine
    smooth = _smoothed(share, change, fine)
    step = smooth / (MESH_RATIO**MESH_ORDER - 1.0)
    factor = fine / usual * (1.0 + step)
    errors = {"the mesh": ERROR_SHARE_OF_STEP * step}
    # The ripple of the fine mesh is smaller than what the two differ by, in the ratio of their errors.
    ripple = float(np.sqrt(np.average((change - smooth) ** 2, weights=fine**2))) / MESH_RATIO**MESH_ORDER
    columns = np.polynomial.legendre.legvander(2.0 * share - 1.0, RIPPLE_DEGREE).T
    errors |= {f"ripple of the mesh, part {k}": ripple * column / np.sqrt(len(columns)) for k, column in enumerate(columns)}
    if len(answers) > 3:
        rounding = _smoothed(share, (fine - answers[3][pressed]) / fine, fine)
        factor = factor * (1.0 + rounding)
        errors["the sharp edge"] = ERROR_SHARE_OF_EDGE * rounding
    if remembering is not None:
        left = (remembering.refinement * MESH_RATIO / _finest(ramp, remembering)) ** MESH_ORDER
        errors[RIPPLE_IN_MEMORY] = left * REMEMBERED_SHARE * (factor - _smoothed(share, factor, fine))
    order = np.argsort(depth, kind="stable")
    return Correction(depth[order], factor[order], {name: column[order] for name, column in errors.items()})


def _smoothed(share: np.ndarray, change: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """A relative change (m,) as a polynomial of the depth, fitted where the answer is large."""
    degree = min(SMOOTH_DEGREE, len(share) - 1)
    return np.polynomial.Polynomial.fit(share, change, degree, w=weight, domain=[0.0, 1.0])(share)
