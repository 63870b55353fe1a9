"""What a finer mesh would answer: a coarse run corrected by a factor of the depth, read off a few elastic ramps.

Where the edge of a tool passes the nodes of a mesh, the answer ripples with the depth. This error and the stiffness that a
mesh adds depend on where the surface is, hardly on time and little on the constants. The ratio of what the tissue answers to
one ramp on a fine mesh and on the usual one therefore corrects any load history of the same test. The ramps are computed for
the tissue with its effects. Where a tissue is history-dependent, the ripple of earlier depths stays in its stress: there each
test is followed on the usual mesh and on a finer one, and the ratio of these answers to what the ramps predict of it is a
factor of each row.

The exact answer is smooth in the load while the ripple is not, and what is left of the error of a mesh falls with a power of
the size of its elements (Richardson 1911). The logarithm of the answers of three meshes is therefore fitted by a polynomial
of the load plus a line times that power, with weights by the ripple of each mesh. The degree is chosen by generalized cross-
validation (Golub, Heath & Wahba 1979). An edge that is stated as sharp is computed with two radii of rounding and
extrapolated to none, since the force is linear in a small radius. Where a tissue is incompressible, a ramp with twice the
compressibility of the elements shows what theirs changes, which is linear in it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from explicitfe.effects import Measurement, physics_of, readings_of
from explicitfe.measured.course import INSTANTS_OF_A_FULL_MOTION
from explicitfe.measured.curve import Curve, programme_of
from explicitfe.predict.experiment import experiments
from explicitfe.predict.reading import as_it_is, true_programme, without_compliance
from explicitfe.predict.setup import RADIUS_OVER_SHARP_EDGE
from explicitfe.predict.tissue import Numerics, Tissue
from explicitfe.predict.under_a_tool import is_homogeneous

# Rows of a ramp: between two of them an answer is nearly straight.
RAMP_ROWS = 49
# Density of the instants of a ramp. With 16 of them, an answer between two follows no ripple: the
# depth under a flat tool scatters by 2.9 micrometres as the constants change by 2 %, with 48 by 0.8.
RAMP_DENSITY = 2.0
# Numbers of instants and the tolerance of the fine ramps. A fit averages the residuals of their equilibria: with 2e-4 the depth
# changes by 1 micrometre. A history is compared row by row, with a tighter tolerance.
FINE_DENSITY, FINE_TOLERANCE = 1.5, 5e-4
HISTORY_TOLERANCE = 2e-4
# Power of the element size with which the error of a mesh falls, and its standard deviation. Refinements of 0.6, 1.0 and 1.5
# under a flat tool are off by 32.6, 13.5 and 6.7 micrometres: 1.73 and 1.74. Contact lowers the 2 of a smooth solution.
MESH_ORDER, MESH_ORDER_SD = 1.75, 0.2
# Power of the element size with which the ripple falls: 12.5, 4.4 and 2.1 micrometres on these meshes.
RIPPLE_ORDER = 2.0
# The finer mesh on which a history is followed is coarser than the finest mesh by this ratio.
MESH_RATIO = 1.5
# A body without rotational symmetry has so many elements that its ramps are no finer than this.
FINEST_IN_SPACE = 1.0
# Degree, in the load, of the relative error of a mesh and of the relative change by a rounded edge.
ERROR_DEGREE, EDGE_DEGREE = 1, 2
# Largest degree of the polynomial for the exact answer.
LARGEST_DEGREE = 5
# Degree of the polynomial that smooths the answer to one ramp.
SMOOTH_DEGREE = 5
# Singular values below this share of the largest one count as zero: a short ramp has fewer rows than unknowns.
RANK_TOLERANCE = 1e-12
# Errors of the fit that together make up less than this share of its variance are left out.
NEGLIGIBLE_VARIANCE_SHARE = 1e-2
# The step from a rounded edge to a sharp one is linear in the radius to a tenth. But an edge that is called sharp is broken by
# some tenth of a millimetre where it was machined: of a tool of 12 mm that is 0.3 of the step from its 28th part, one standard
# deviation.
ERROR_SHARE_OF_EDGE = 0.3
# The step from the compressibility of the elements to none is linear to this share: of the 18 micrometres between Poisson's
# ratios of 0.499 and 0.5 under a flat tool.
ERROR_SHARE_OF_LIMIT = 0.1
# What a tissue remembers of a mesh's ripple has mostly cancelled, while the factor undoes all of it at the depth of now. About so
# much of the force of a tissue that relaxes is what it remembers; of the ripple of the finer mesh it is an error.
REMEMBERED_SHARE = 0.3
# Where an answer is a smaller share of the largest one, its ratio to another says nothing.
LEAST_COMPARED_SHARE = 0.02
RIPPLE_IN_MEMORY = "ripple in history-dependent stress"

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
    smooth : (m,) fine answer over the smooth part of the coarse one. How a mesh ripples depends on the constants too, so answers
        that are read off a ramp are smoothed instead.
    limit : (m,) a further factor, to the incompressible limit, for a tissue that has one.
    """

    depth_m: np.ndarray
    factor: np.ndarray
    errors: Mapping[str, np.ndarray]
    remembered: Mapping[str, np.ndarray] = field(default_factory=dict)
    smooth: np.ndarray | None = None
    limit: np.ndarray | None = None

    def of_ramp(self, answer: np.ndarray, programme: np.ndarray, by_force: bool, incompressible: bool = True) -> np.ndarray:
        """A smooth answer (k,) to a ramp, see :func:`smoothed`, corrected."""
        factor = self.factor if self.smooth is None else self.smooth
        return answer * self._at(self._with_limit(factor, incompressible), answer, programme, by_force)

    def _with_limit(self, factor: np.ndarray, incompressible: bool) -> np.ndarray:
        return factor * self.limit if incompressible and self.limit is not None else factor

    def applied(
        self,
        answer: np.ndarray,
        programme: np.ndarray,
        by_force: bool,
        followed: Sequence[Curve] = (),
        compliance_m_N: float = 0.0,
        incompressible: bool = True,
    ) -> np.ndarray:
        """A coarse answer (k,) to a true programme (k,), corrected.

        Parameters
        ----------
        followed : curves whose own courses the answer follows, row by row, one after the other.
        compliance_m_N : of the rig, whose part of the displacement needs no correction.
        incompressible : whether the tissue has an incompressible limit.
        """
        rig = compliance_m_N * (programme if by_force else answer)
        tissue, moved = (answer - rig, programme) if by_force else (answer, programme - rig)
        factor = self._with_limit(self.factor, incompressible)
        corrected = tissue * self._at(factor, tissue, moved, by_force) + (rig if by_force else 0.0)
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
    physics, readings = physics_of(tissue.effects.chosen), readings_of(tissue.effects.chosen)
    kinds: dict[str, list[Curve]] = {}
    for test in experiments(curves):
        if tissue.numerics.finer > 0.0 and test[0].tool is not None and not is_homogeneous(test[0], physics):
            kinds.setdefault(kind_of(test[0]), []).extend(test)
    remembers = any(effect.remembers for effect in tissue.effects.chosen)
    plain = _without_memory(tissue)
    ladders = {kind: _ladder(ramp_of(alike[0], alike, readings), plain) for kind, alike in kinds.items()}
    histories = {kind: _histories(tissue, alike) if remembers else [] for kind, alike in kinds.items()}
    runs = iter(run([job for kind, ladder in ladders.items() for job in [*ladder.values(), *histories[kind]]]))
    by_curve: dict[str, Correction] = {}
    for kind, ladder in ladders.items():
        answers = {name: answer[0] for name, answer in ((name, next(runs)) for name in ladder) if not isinstance(answer, str)}
        followed = [next(runs) for _ in histories[kind]]
        if len(answers) < len(ladder):
            continue
        (ramp,), _ = ladder["usual"]
        correction = _correction(ramp, answers, tissue.numerics, remembers)
        if remembers:
            correction = replace(correction, remembered=_remembered(ramp, answers, histories[kind], followed))
        by_curve |= {curve.id: correction for curve in kinds[kind]}
    return by_curve


def _histories(tissue: Tissue, alike: Sequence[Curve]) -> list[Job]:
    """Each test as it really is, on the usual mesh and then on the finer one with which ratios in its memory are known."""
    readings = readings_of(tissue.effects.chosen)
    tissue = tissue.model_copy(update={"effects": tissue.effects.without(readings)})
    tissue = without_compliance(tissue)[0] if alike[0].imposed == "force_N" else tissue
    finer = {"refinement": _finest(alike[0], tissue.numerics) / MESH_RATIO, "tolerance": HISTORY_TOLERANCE}
    texts = [tissue.text, tissue.model_copy(update={"numerics": tissue.numerics.model_copy(update=finer)}).text]
    return [(tuple(as_it_is(curve, readings) for curve in test), text) for test in experiments(alike) for text in texts]


def _remembered(
    ramp: Curve, answers: Mapping[str, np.ndarray], histories: Sequence[Job], followed: Sequence[Run]
) -> dict[str, np.ndarray]:
    """Curve -> what a finer mesh changes in its rows over what it changes in a ramp at the same depth."""
    by_force = ramp.imposed == "force_N"
    programme, usual, between = programme_of(ramp), answers["usual"], answers["between"]
    pressed = (usual > 0.0) & (between > 0.0) & (programme > 0.0)
    depth = np.maximum.accumulate(usual if by_force else programme)[pressed]
    changed = between[pressed] / usual[pressed]
    factors: dict[str, np.ndarray] = {}
    for (test, _), coarse, finer in zip(histories[::2], followed[::2], followed[1::2], strict=True):
        if isinstance(coarse, str) or isinstance(finer, str):
            continue
        for curve, one, other in zip(test, coarse, finer, strict=True):
            predicted = np.interp(one if by_force else programme_of(curve), depth, changed)
            compared = np.minimum(one, other) > LEAST_COMPARED_SHARE * one.max(initial=0.0)
            factors[curve.id] = np.where(compared, other / np.where(compared, one, 1.0) / predicted, 1.0)
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
    return without_compliance(tissue.model_copy(update={"effects": tissue.effects.without(dropped)}))[0]


def _ladder(ramp: Curve, tissue: Tissue) -> dict[str, Job]:
    """The ramp on the usual mesh, on a fine one and on one between them; with a sharp edge also with twice the rounding,
    and of an incompressible tissue with twice the compressibility.

    The run on the usual mesh is the one that a search reads its answers from.
    """
    assert ramp.specimen is not None and ramp.tool is not None
    finest = _finest(ramp, tissue.numerics)

    def job(curve: Curve, refinement: float) -> Job:
        numerics = Numerics(refinement=refinement, density=FINE_DENSITY, tolerance=FINE_TOLERANCE)
        return (curve,), tissue.model_copy(update={"numerics": numerics}).text

    tissue = for_ramps(tissue)
    jobs: dict[str, Job] = {"usual": ((ramp,), tissue.text), "fine": job(ramp, finest)}
    jobs["between"] = job(ramp, finest / MESH_RATIO)
    if tissue.incompressible:
        jobs["softer"] = (ramp,), tissue.model_copy(update={"poisson": 2.0 * tissue.poisson - 0.5}).text
    if _is_sharp(ramp):
        assert ramp.tool.radius_mm is not None
        rounded = ramp.tool.model_copy(update={"edge_radius_mm": 2.0 * ramp.tool.radius_mm / RADIUS_OVER_SHARP_EDGE})
        jobs["rounder"] = job(replace(ramp, tool=rounded), finest)
    return jobs


def for_ramps(tissue: Tissue) -> Tissue:
    """The tissue with the instants of a ramp whose answers are corrected."""
    if tissue.numerics.finer == 0.0:
        return tissue
    numerics = tissue.numerics.model_copy(update={"density": max(RAMP_DENSITY, tissue.numerics.density)})
    return tissue.model_copy(update={"numerics": numerics})


def _finest(curve: Curve, numerics: Numerics) -> float:
    """Refinement of the finest mesh."""
    assert curve.specimen is not None
    return numerics.finer if curve.specimen.size_mm is None else min(numerics.finer, FINEST_IN_SPACE)


def _is_sharp(curve: Curve) -> bool:
    assert curve.tool is not None
    return curve.tool.shape == "flat-cylinder" and curve.tool.edge_radius_mm == 0.0


def _correction(ramp: Curve, answers: Mapping[str, np.ndarray], numerics: Numerics, remembers: bool) -> Correction:
    """The correction from the answers (RAMP_ROWS,) to a ladder of ramps, see :func:`_ladder`."""
    by_force = ramp.imposed == "force_N"
    programme = programme_of(ramp)
    pressed = np.all([answer > 0.0 for answer in answers.values()], axis=0) & (programme > 0.0)
    if not pressed.any():
        return Correction(np.zeros(1), np.ones(1), {})
    rows = {name: answer[pressed] for name, answer in answers.items()}
    usual, fine, load = rows["usual"], rows["fine"], programme[pressed]
    share, finest = load / load[-1], _finest(ramp, numerics)
    meshes = [
        Mesh(1.0, FINE_DENSITY, np.log(fine / load)),
        Mesh(MESH_RATIO, FINE_DENSITY, np.log(rows["between"] / load)),
        Mesh(finest / numerics.refinement, max(RAMP_DENSITY, numerics.density), np.log(usual / load)),
    ]
    fit = _extrapolated(share, meshes, fine)
    factor = load * np.exp(fit.level) / usual
    # A step of h^p between sizes that differ by MESH_RATIO changes with p as (R^p - 1)^-1 does.
    growth = MESH_RATIO**MESH_ORDER
    errors = {"the mesh": MESH_ORDER_SD * growth * np.log(MESH_RATIO) / (growth - 1.0) * fit.step}
    errors |= {f"ripple of the mesh, part {k}": mode for k, mode in enumerate(fit.modes.T)}
    columns = _columns(share, EDGE_DEGREE)
    if "rounder" in rows:
        rounding = _projected(columns, (fine - rows["rounder"]) / fine, fine)
        factor = factor * (1.0 + rounding)
        errors["the sharp edge"] = ERROR_SHARE_OF_EDGE * rounding
    limit = np.ones(len(load))
    if "softer" in rows:
        step = _projected(columns, (usual - rows["softer"]) / usual, fine)
        limit = 1.0 + step
        errors["the incompressible limit"] = ERROR_SHARE_OF_LIMIT * step
    if remembers:
        ripple = factor - _projected(columns, factor, fine)
        errors[RIPPLE_IN_MEMORY] = (numerics.refinement * MESH_RATIO / finest) ** RIPPLE_ORDER * REMEMBERED_SHARE * ripple
    depth = usual if by_force else load
    order = np.argsort(depth, kind="stable")
    smooth = factor * usual / smoothed(usual, load)
    return Correction(
        depth[order],
        factor[order],
        {name: column[order] for name, column in errors.items()},
        smooth=smooth[order],
        limit=limit[order],
    )


# ---- smooth functions of the load ----


def smoothed(answer: np.ndarray, programme: np.ndarray) -> np.ndarray:
    """The answer (m,) to a ramp without the ripple of its mesh: its ratio to the load is a polynomial plus a logarithm.

    Rows where nothing is pressed stay as they are.
    """
    pressed = (answer > 0.0) & (programme > 0.0)
    if np.count_nonzero(pressed) <= SMOOTH_DEGREE + 2:
        return answer
    y, load = answer[pressed], programme[pressed]
    share = load / load[-1]
    columns = np.column_stack([_columns(share, SMOOTH_DEGREE), np.log(share)])
    smooth = answer.copy()
    smooth[pressed] = load * _projected(columns, y / load, load)
    return smooth


class Mesh(NamedTuple):
    """Logarithms (m,) of the answers over the load on a mesh of an element size, relative to the finest one."""

    size: float
    density: float
    rows: np.ndarray


class LadderFit(NamedTuple):
    """The extrapolation of several meshes.

    Attributes
    ----------
    level : (m,) logarithm of the answer over the load on an infinitely fine mesh.
    step : (m,) what is extrapolated from the finest mesh.
    modes : (m, k) independent errors of ``level`` by the ripple, one standard deviation each.
    score : of the generalized cross-validation.
    """

    level: np.ndarray
    step: np.ndarray
    modes: np.ndarray
    score: float


def _columns(share: np.ndarray, degree: int) -> np.ndarray:
    """Polynomials (m, degree + 1) of the share (m,) of the load; no more of them than rows."""
    return np.polynomial.legendre.legvander(2.0 * share - 1.0, min(degree, len(share) - 1))


def _projected(columns: np.ndarray, rows: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """The sum of columns (m, p) that fits rows (m,) best."""
    basis, _ = np.linalg.qr(weight[:, None] * columns)
    return basis @ (basis.T @ (weight * rows)) / weight


def _extrapolated(share: np.ndarray, meshes: Sequence[Mesh], answer: np.ndarray) -> LadderFit:
    """The fit of the degree that predicts left-out rows best.

    The logarithm of the load stands for the onset of contact, where the force is a power of the depth.
    """
    fits = []
    for degree in range(1, LARGEST_DEGREE + 1):
        columns = _columns(share, degree)
        fits += [_fit(share, c, meshes, answer) for c in (columns, np.column_stack([columns, np.log(share)]))]
    return min(fits, key=lambda fit: fit.score)


def _fit(share: np.ndarray, columns: np.ndarray, meshes: Sequence[Mesh], answer: np.ndarray) -> LadderFit:
    """Least squares for the exact answer, as a sum of columns (m, p), and for the error of the meshes.

    Rows are interpolated between fewer instants: only those are independent of each other.
    """
    error = _columns(share, ERROR_DEGREE)
    counts = [INSTANTS_OF_A_FULL_MOTION * mesh.density * len(share) / (RAMP_ROWS - 1) for mesh in meshes]
    weights = [answer * mesh.size**-RIPPLE_ORDER * np.sqrt(n / len(share)) for mesh, n in zip(meshes, counts, strict=True)]
    both = [np.column_stack([columns, mesh.size**MESH_ORDER * error]) for mesh in meshes]
    matrix = np.concatenate([w[:, None] * c for w, c in zip(weights, both, strict=True)])
    rows = np.concatenate([w * mesh.rows for w, mesh in zip(weights, meshes, strict=True)])
    left, size, right = np.linalg.svd(matrix, full_matrices=False)
    kept = size > RANK_TOLERANCE * size[0]
    inverse = right[kept].T / size[kept]
    coefficients = inverse @ (left[:, kept].T @ rows)
    misfit = float(np.sum((rows - matrix @ coefficients) ** 2))
    independent = sum(counts)
    free = max(independent - np.count_nonzero(kept), 1.0)
    exact = np.column_stack([columns, 0.0 * error])
    modes = _principal(np.sqrt(misfit / free) * exact @ inverse, answer)
    return LadderFit(exact @ coefficients, -error @ coefficients[columns.shape[1] :], modes, misfit / free**2)


def _principal(modes: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """The fewest errors (m, k) that stand for many (m, p): those of the largest variance, weighted by the answers."""
    left, size, _ = np.linalg.svd(weight[:, None] * modes, full_matrices=False)
    variance = size**2
    remaining = variance.sum() - np.cumsum(variance)
    count = 1 + int(np.count_nonzero(remaining > NEGLIGIBLE_VARIANCE_SHARE * variance.sum()))
    return left[:, :count] * size[:count] / weight[:, None]
