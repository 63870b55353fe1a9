"""``explicitfe predict``: measured curves predicted by the simulator, with the constants and effects of a model file."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np
from pydantic import ValidationError

from explicitfe.fem.inputs.sentences import explain
from explicitfe.fem.inputs.table import validated
from explicitfe.inverse.measured.curve import PRINTED_UNITS, Curve, programme_of
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.inverse.predict.correction import Correction, Job, Run, corrections_of
from explicitfe.inverse.predict.experiment import CurveAnswer, effects_of, experiments
from explicitfe.inverse.predict.homogeneous import LOADS, HomogeneousTest, predict_homogeneous
from explicitfe.inverse.predict.reading import without_compliance
from explicitfe.inverse.predict.tissue import Numerics, Tissue, effect_name, read_tissue
from explicitfe.inverse.predict.under_a_tool import predict_under_a_tool
from explicitfe.platform.compiled.threads import cores
from explicitfe.platform.errors import InputError, Progress, RunError, counted, nearest, shortened, silent
from explicitfe.platform.host import stopping
from explicitfe.platform.host.compilation import announcing
from explicitfe.platform.host.worker_pool import WorkerPool
from explicitfe.results.documents.prediction import PredictedCurve, PredictedRows, Prediction, PredictionError


def predict_curves(
    dataset_path: Path | str,
    model_path: Path | str,
    *,
    curves: Sequence[str] = (),
    refinement: float | None = None,
    density: float | None = None,
    tolerance: float | None = None,
    processes: int | None = None,
    progress: Progress = silent,
) -> tuple[Prediction, dict[str, str]]:
    """Predict the curves of a dataset; see :func:`explicitfe.predict`.

    Returns
    -------
    prediction : a curve that was not reached has the status "failed", a message, and no prediction.
    files : name -> text of the model file and of one table per curve.
    """
    begin = time.perf_counter()
    tissue = read_tissue(model_path)
    dataset = read_dataset(dataset_path).specimens("a model file predicts")
    tissue = _with_numerics(tissue, refinement, density, tolerance)
    try:
        dataset = tissue.grouped(dataset)
    except InputError as error:
        raise InputError(f"{model_path}: {error}") from None
    known = [curve.id for curve in dataset.curves]
    for name in curves:
        if name not in known:
            raise InputError(f'{dataset.path}: there is no curve "{shortened(name)}"; {nearest(name, known)}')
    wanted = set(curves or known)
    tests = [test for test in experiments(dataset.curves) if wanted & {curve.id for curve in test}]
    corrections = corrections_of(tissue, [curve for test in tests for curve in test], _run)
    answers = _predict_tests(tests, tissue, corrections, processes, progress)
    rows = {curve.id: _row(curve, answers[curve.id]) for curve in dataset.curves if curve.id in wanted}
    prediction = Prediction(
        dataset=dataset.name,
        model=str(model_path),
        effects=[effect_name(effect) for effect in tissue.effects.chosen],
        **tissue.numerics.model_dump(),
        curves=rows,
        error=_mean_errors(list(rows.values())),
        assumed=sorted({text for a in answers.values() if isinstance(a, CurveAnswer) for text in a.assumed}),
        wall_s=time.perf_counter() - begin,
    )
    return prediction, {"model.toml": tissue.text} | {f"{name}.csv": _csv(curve) for name, curve in rows.items()}


def predict_test(
    test: Sequence[Curve],
    tissue: Tissue,
    *,
    refinement: float | None = None,
    density: float | None = None,
    tolerance: float | None = None,
    corrections: Mapping[str, Correction] = MappingProxyType({}),
    variants: Sequence[Tissue] = (),
) -> list[CurveAnswer]:
    """What a tissue answers to the curves of one test, see :func:`experiments`; options as for :func:`predict`.

    Parameters
    ----------
    corrections : curve -> the correction of its answer; what has none is as it is computed.
    variants : tissues with the same effects and slightly other numbers, for :attr:`CurveAnswer.variants`.

    Raises
    ------
    InputError : an effect does not go with the test, or there are no constants for it.
    RunError : a state is not reached.
    """
    first = test[0]
    if first.kind in LOADS:
        (answer,) = predict_tests([test], tissue)
        if isinstance(answer, RunError):
            raise answer
        return answer
    effects = effects_of(first, tissue)
    laws = tissue.law(first), tissue.law(first, homogeneous=True)
    numerics = _with_numerics(tissue, refinement, density, tolerance).numerics
    others = [(one.law(first), effects_of(first, one)) for one in variants]
    correction, corrected = corrections.get(first.id), None
    if correction is not None:
        corrected = partial(correction.applied, compliance_m_N=without_compliance(tissue)[1])
    return predict_under_a_tool(test, *laws, effects, numerics, corrected, tissue.incompressible, others)


def predict_tests(
    tests: Sequence[Sequence[Curve]], tissue: Tissue, variants: Sequence[Tissue] = ()
) -> list[list[CurveAnswer] | RunError]:
    """As :func:`predict_test`, of tests of one kind; without a tool they are computed together and have an error each."""
    if tests[0][0].kind not in LOADS:
        return [predict_test(test, tissue, variants=variants) for test in tests]
    return predict_homogeneous(
        [HomogeneousTest(test, tissue.law(test[0], homogeneous=True), effects_of(test[0], tissue)) for test in tests]
    )


def kernels_of_test(test: Sequence[Curve], tissue: Tissue) -> str:
    """Describe the compiled kernels that a test needs, such as "indentation tests with viscoelastic"."""
    effects = ", ".join(effect_name(effect) for effect in tissue.effects.chosen)
    return f"{test[0].kind} tests" + (f" with {effects}" if effects else "")


def _with_numerics(tissue: Tissue, refinement: float | None, density: float | None, tolerance: float | None) -> Tissue:
    """The tissue with other numerics, where they are given."""
    given = {"refinement": refinement, "density": density, "tolerance": tolerance}
    data = tissue.numerics.model_dump() | {name: value for name, value in given.items() if value is not None}
    try:
        return tissue.model_copy(update={"numerics": validated(Numerics, data)})
    except ValidationError as error:
        raise InputError(explain(error, data, Numerics)) from None


# ---- all tests ----


def _run(jobs: list[Job]) -> list[Run]:
    """The ramps of corrections, one after the other."""
    return [
        answers if isinstance(answers, str) else [answer.values for answer in answers]
        for answers in (_answers_or_message(test, tissue, {}) for test, tissue in jobs)
    ]


def _answers_or_message(test: Sequence[Curve], tissue: Tissue, corrections: Mapping[str, Correction]) -> list[CurveAnswer] | str:
    """What a tissue answers, or why it does not."""
    try:
        with announcing(kernels_of_test(test, tissue)):
            return predict_test(test, tissue, corrections=corrections)
    except RunError as error:
        return str(error)


def _predict_tests(
    tests: Sequence[Sequence[Curve]],
    tissue: Tissue,
    corrections: Mapping[str, Correction],
    processes: int | None,
    progress: Progress,
) -> dict[str, CurveAnswer | str]:
    """Curve -> its prediction, or what went wrong."""
    answers: dict[str, CurveAnswer | str] = {}

    def keep(test: Sequence[Curve], answer: list[CurveAnswer] | str) -> None:
        for number, curve in enumerate(test):
            answers[curve.id] = answer if isinstance(answer, str) else answer[number]
        progress("predict", counted(len(answers), sum(map(len, tests)), "curve"))

    progress("predict", 0.0)
    # This process computes the first test: that compiles the kernels, which the other processes then load.
    keep(tests[0], _answers_or_message(tests[0], tissue, corrections))
    remaining = list(tests[1:])
    workers = min(cores(), len(remaining))
    workers = min(workers, processes or workers)
    if workers > 1 and tests[0][0].tool is not None:
        try:
            with WorkerPool(workers) as pool:
                jobs = {pool.submit(_answers_or_message, test, tissue, corrections): test for test in remaining}
                for job in as_completed(jobs):
                    keep(jobs[job], job.result())
            return answers
        except BrokenProcessPool:  # Some callers, such as a script from standard input, cannot start processes.
            stopping.check()
            remaining = [test for test in remaining if test[0].id not in answers]
    for test in remaining:
        keep(test, _answers_or_message(test, tissue, corrections))
    return answers


# ---- rows ----


def _row(curve: Curve, answer: CurveAnswer | str) -> PredictedCurve:
    unit, factor = PRINTED_UNITS[curve.predicted]
    imposed_unit, imposed_factor = {"displacement_m": ("mm", 1e3), "force_N": ("N", 1.0)}.get(curve.imposed, ("", 1.0))
    measured = factor * curve.columns[curve.predicted]
    columns = {
        "time_s": curve.time_s.tolist(),
        "imposed": (imposed_factor * programme_of(curve)).tolist(),
        "measured": measured.tolist(),
    }
    row = {
        "split": curve.split,
        "constants": curve.constants,
        "quantity": curve.predicted.rsplit("_", 1)[0],
        "unit": unit,
        "imposed": curve.imposed.rsplit("_", 1)[0] if imposed_unit else curve.imposed,
        "imposed_unit": imposed_unit,
    }
    if isinstance(answer, str):
        return PredictedCurve(status="failed", rows=PredictedRows(**columns), message=answer, **row)
    values = factor * answer.values
    rmse = float(np.sqrt(np.mean((values - measured) ** 2)))
    largest = float(np.abs(measured).max())
    return PredictedCurve(
        status="predicted",
        rows=PredictedRows(**columns, predicted=values.tolist()),
        rmse=rmse,
        nrmse=rmse / largest if largest > 0.0 else None,
        largest_measured=largest,
        instants=answer.instants,
        iterations=answer.iterations,
        seconds=answer.seconds,
        **row,
    )


def _mean_errors(curves: Sequence[PredictedCurve]) -> dict[str, PredictionError]:
    """Side -> mean error of the curves that have one."""
    sides: dict[str, list[float]] = {}
    for curve in curves:
        if curve.nrmse is not None:
            sides.setdefault(curve.split or "all", []).append(curve.nrmse)
    return {side: PredictionError(curves=len(values), nrmse=float(np.mean(values))) for side, values in sides.items()}


def _csv(curve: PredictedCurve) -> str:
    """Time, what was imposed, what was measured, and what was predicted unless the curve failed."""
    rows = curve.rows
    quantity = f"{curve.quantity}_{curve.unit}"
    columns = {
        "time_s": rows.time_s,
        f"{curve.imposed}_{curve.imposed_unit}" if curve.imposed_unit else curve.imposed: rows.imposed,
        f"measured_{quantity}": rows.measured,
    }
    if rows.predicted is not None:
        columns[f"predicted_{quantity}"] = rows.predicted
    lines = [",".join(f"{value:.9g}" for value in line) for line in zip(*columns.values(), strict=True)]
    return "\n".join([",".join(columns), *lines]) + "\n"
