"""Functions on measured data: they compute, and write a folder with a document, a page and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from explicitfe.platform.errors import Progress, silent

if TYPE_CHECKING:  # the command line reads signatures and docstrings before it imports what computes
    from explicitfe.inverse.close_loop.report import LoopDocuments
    from explicitfe.results.documents.document import Document
    from explicitfe.results.documents.identification import Identification
    from explicitfe.results.documents.loop_report import LoopReport
    from explicitfe.results.documents.planned_test import PlannedTest, ProposedTests
    from explicitfe.results.documents.prediction import Prediction

PREDICTION_FILE, PREDICTION_PAGE = "predict.json", "predict.html"
PLAN_FILE, PLAN_PAGE = "design-test.json", "design-test.html"
PROPOSALS_FILE = "proposed-tests.json"


def identify(
    dataset: Path | str,
    *,
    law: str | None = None,
    method: str = "least-squares",
    out: Path | str | None = None,
    fit: Sequence[str] = (),
    constants_by: str | None = None,
    poisson: float | None = None,
    refinement: float = 1.5,
    overwrite: bool = False,
    progress: Progress = silent,
) -> Identification:
    """Fit the constants of a material law to measured curves.

    Parameters
    ----------
    dataset : folder of the dataset, its dataset.toml, or the name of a dataset that comes with the program.
    law : material law: yeoh | neo-hooke | mooney-rivlin | yeoh-3 | ogden-1 | ogden-2 | ogden-3 | all. With all, the law with the
        lowest AICc is reported; by default yeoh, compared with all laws in homogeneous tests.
    method : fitting method: least-squares | paper (the iteration of Gérard et al. 2005).
    out : output folder for identify.json, a page, pictures and a scenario with the fitted constants; by default none is written.
    fit : fit only curves with this condition, KEY=VALUE, and predict the others.
    constants_by : condition, or group, by which curves share constants: those with the same value share them.
    poisson : Poisson's ratio. It is assumed, not fitted; by default 0.5 (incompressible) in closed forms, 0.499 in elements.
    refinement : mesh refinement of the simulations: divides the element size.
    overwrite : replace the files of an earlier identification.
    progress : called with "compile" or "identify" and the completed share.

    Returns
    -------
    The answer of ``explicitfe identify --json``; see docs/reference/identify.md.

    Raises
    ------
    InputError : the dataset or an option cannot be used. Nothing is written.
    RunError : no group could be identified.
    """
    from explicitfe.app.api.write_identification import SUMMARY_FILE, write_identification
    from explicitfe.inverse.identify.identify import identify_constants
    from explicitfe.results.files.folder import checked_target

    target = None if out is None else checked_target(Path(out), overwrite, summary=SUMMARY_FILE, what="identification")
    identification, pictures = identify_constants(
        dataset,
        law=law,
        method=method,
        fit=fit,
        constants_by=constants_by,
        poisson=poisson,
        refinement=refinement,
        progress=progress,
    )
    if target is not None:
        write_identification(target, identification, pictures)
    return identification


def predict(
    dataset: Path | str,
    model: Path | str,
    *,
    out: Path | str | None = None,
    curves: Sequence[str] = (),
    refinement: float | None = None,
    density: float | None = None,
    tolerance: float | None = None,
    processes: int | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
) -> Prediction:
    """Predict the curves of a dataset with the constants and effects of a model file.

    Parameters
    ----------
    dataset : folder of the dataset, its dataset.toml, or the name of a dataset that comes with the program.
    model : model file (TOML) with constants and effects, such as model.toml of :func:`close_loop`.
    out : output folder for predict.json, a page and one CSV file per curve; by default none is written.
    curves : ids of the curves to predict; by default all.
    refinement : divide element sizes by this factor; by default that of the model file.
    density : multiply the numbers of instants of tests under a tool by this factor; by default that of the model file.
    tolerance : relative force residual of an equilibrium; by default that of the model file.
    processes : largest number of processes; by default the number of cores.
    overwrite : replace existing results.
    progress : called with the stage and the share of it that is done.

    Returns
    -------
    What predict.json holds; a curve that was not reached has the status "failed", a message, and no prediction.

    Raises
    ------
    InputError : a file, a key or an option cannot be used.
    """
    from explicitfe.app.view.page.predict import predict_page
    from explicitfe.inverse.predict.predict import predict_curves
    from explicitfe.results.files.folder import checked_target

    target = None if out is None else checked_target(Path(out), overwrite, summary=PREDICTION_FILE, what="prediction")
    prediction, files = predict_curves(
        dataset,
        model,
        curves=curves,
        refinement=refinement,
        density=density,
        tolerance=tolerance,
        processes=processes,
        progress=progress,
    )
    if target is not None:
        names = ["model.toml", PREDICTION_FILE, PREDICTION_PAGE, *(name for name in files if name != "model.toml")]
        prediction = prediction.model_copy(update={"files": [str(target / name) for name in names]})
        page = predict_page(prediction, str(dataset))
        _write(target, PREDICTION_FILE, prediction, {**files, PREDICTION_PAGE: page})
    return prediction


def close_loop(
    dataset: Path | str,
    *,
    out: Path | str | None = None,
    add: Sequence[Path | str] = (),
    holdout: Sequence[str] = (),
    constants_by: str | None = None,
    effects: Sequence[str] = (),
    max_effects: int = 3,
    simulations: int | Literal["usual"] | None = None,
    minutes: float | None = None,
    processes: int | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
) -> LoopReport:
    """Find which effect a model lacks, from measured curves.

    Parameters
    ----------
    dataset : folder of the dataset, its dataset.toml, or the name of a dataset that comes with the program.
    out : output folder for report.html, report.json, pictures and model files; by default none is written.
    add : further datasets of the same specimen and machine whose curves are fitted too, such as a proposed test.
    holdout : ids of curves to hold out: they are predicted and not fitted; by default chosen by the dataset or by a rule.
    constants_by : condition, or group, by which curves share constants, such as direction; by default as the dataset says, unless
        equal tests on several specimens show that one set cannot serve all of them.
    effects : names of the effects to consider; by default all.
    max_effects : largest number of effects to add; several terms of one effect count separately.
    simulations : the search ends after so many simulations, but fits may take as many as what precedes them. "usual" is 4 000 for
        homogeneous tests and 200 elsewhere, None is no limit. Hypotheses that were not fitted keep their estimates, and a warning
        names them. The verdict does not depend on the machine.
    minutes : safety limit on the time, even within a simulation; None is no limit. A search that it ends before the effects are
        screened has the verdict "failed".
    processes : largest number of processes; by default the number of cores.
    overwrite : replace an existing report.
    progress : called with the stage and the share of it that is done.

    Returns
    -------
    What ``report.json`` holds. A fit that cannot be done has the verdict "failed" and a message.

    Raises
    ------
    InputError : a dataset or an option that cannot be used; nothing is written.
    """
    from explicitfe.inverse.close_loop.close import find_causes
    from explicitfe.inverse.close_loop.report import SUMMARY
    from explicitfe.results.files.folder import checked_target

    target = None if out is None else checked_target(Path(out), overwrite, summary=SUMMARY, what="report")
    documents = find_causes(
        dataset,
        add=add,
        holdout=holdout,
        constants_by=constants_by,
        effects=effects,
        max_effects=max_effects,
        simulations=simulations,
        minutes=minutes,
        processes=processes,
        progress=progress,
    )
    if target is not None:
        write_loop(target, documents)
    return documents.report


def write_loop(target: Path, documents: LoopDocuments) -> None:
    """Write the page of a closed loop, its pictures, the models and the report into a folder, completely or not at all.

    Raises
    ------
    InputError : the folder cannot be written.
    """
    from explicitfe.app.view.page.close_loop import page as loop_page
    from explicitfe.inverse.close_loop.report import SUMMARY
    from explicitfe.results.files.folder import drawing, whole_folder

    report = documents.report
    with whole_folder(target, summary=SUMMARY) as folder:
        names, warnings = [SUMMARY, *documents.files], list(report.warnings)
        with drawing(warnings):
            names += loop_page.write(folder, report, documents.curves, documents.markers)
        report.warnings = warnings
        report.files = [str(target / name) for name in names]
        _fill(folder, SUMMARY, report, documents.files)


def design_test(
    protocol: Path | str,
    *,
    out: Path | str | None = None,
    overwrite: bool = False,
    processes: int | None = None,
    progress: Progress = silent,
) -> PlannedTest:
    """Predict which effects a planned test can detect, and which of them it cannot distinguish.

    Parameters
    ----------
    protocol : a protocol file, see docs/reference/close-loop.md, or the name of a protocol that comes with the program.
    out : output folder for the results (JSON) and a page (HTML); by default none is written.
    overwrite : replace existing results.

    Returns
    -------
    For each effect: whether its largest plausible strength is detectable, the smallest detectable strength, the change of the
    constants if the effect is ignored, and the effect that it is most easily confused with.

    Raises
    ------
    InputError : a protocol that cannot be used, or a folder that cannot be written.
    RunError : the simulator cannot follow it.
    """
    from explicitfe.app.view.page.design import design_page
    from explicitfe.inverse.close_loop.design import plan_test
    from explicitfe.results.files.folder import checked_target

    target = None if out is None else checked_target(Path(out), overwrite, summary=PLAN_FILE, what="plan of a test")
    planned = plan_test(protocol, processes=processes, progress=progress)
    if target is not None:
        planned = planned.model_copy(update={"files": [str(target / name) for name in (PLAN_FILE, PLAN_PAGE)]})
        _write(target, PLAN_FILE, planned, {PLAN_PAGE: design_page(planned)})
    return planned


def propose_tests(
    dataset: Path | str,
    *,
    out: Path | str | None = None,
    overwrite: bool = False,
    processes: int | None = None,
    progress: Progress = silent,
) -> ProposedTests:
    """Propose the tests with the largest expected information per minute.

    Parameters
    ----------
    dataset : report.json of :func:`close_loop` or its folder; or a dataset, on which the loop is closed first.
    out : output folder for proposed-tests.json and a protocol of each test; by default none is written.
    overwrite : replace an earlier answer.

    Raises
    ------
    InputError : a dataset or a report that cannot be used, or a folder that cannot be written.
    """
    from explicitfe.inverse.close_loop.propose import propose, protocols_of
    from explicitfe.results.files.folder import checked_target

    target = None if out is None else checked_target(Path(out), overwrite, summary=PROPOSALS_FILE, what="proposal")
    proposed, report = propose(dataset, processes=processes, progress=progress)
    if target is not None:
        protocols = protocols_of(proposed, report)
        proposed = proposed.model_copy(update={"files": [str(target / name) for name in (PROPOSALS_FILE, *protocols)]})
        _write(target, PROPOSALS_FILE, proposed, protocols)
    return proposed


def _write(target: Path, summary: str, document: Document, files: dict[str, str]) -> None:
    """Write a document and other texts into a folder, completely or not at all."""
    from explicitfe.results.files.folder import whole_folder

    with whole_folder(target, summary=summary) as folder:
        _fill(folder, summary, document, files)


def _fill(folder: Path, summary: str, document: Document, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    (folder / summary).write_text(document.text, encoding="utf-8")
