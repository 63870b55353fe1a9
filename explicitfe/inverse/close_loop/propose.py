"""``explicitfe design-test --propose``: the tests that settle best what a dataset leaves open, each as a protocol."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydantic import ValidationError

from explicitfe.inverse.close_loop.close import find_causes
from explicitfe.inverse.close_loop.report import SUMMARY
from explicitfe.inverse.measured.curve import Dataset
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.platform.errors import InputError, Progress, silent
from explicitfe.platform.host.text import text_of
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.results.documents.loop_report import LoopReport, NextExperiment, estimates
from explicitfe.results.documents.planned_test import ProposedTests


def propose(path: Path | str, *, processes: int | None = None, progress: Progress = silent) -> tuple[ProposedTests, LoopReport]:
    """Propose the tests with the largest expected information per minute; see :func:`explicitfe.propose_tests`.

    Returns
    -------
    proposed : the tests.
    report : the report that they follow from.
    """
    path = Path(path)
    file = path / SUMMARY if path.is_dir() and (path / SUMMARY).is_file() else path
    report = _read(file) if file.suffix == ".json" else find_causes(path, processes=processes, progress=progress).report
    tests = ProposedTests(
        dataset=report.dataset or "",
        file=str(report.provenance.get("dataset", "")),
        verdict=report.verdict or "failed",
        sure=report.sure,
        posterior=report.posterior,
        tests=report.proposed_tests,
    )
    return tests, report


def protocols_of(proposed: ProposedTests, report: LoopReport) -> dict[str, str]:
    """Name of a file -> text of the protocol of each test, which :func:`explicitfe.design_test` takes."""
    dataset = read_dataset(proposed.file)
    return {f"test-{n}.toml": _protocol(test, dataset, report) for n, test in enumerate(proposed.tests, 1)}


def _read(file: Path) -> LoopReport:
    try:
        return LoopReport.model_validate_json(text_of(file, "give a report of close-loop, or a dataset"))
    except ValidationError:
        raise InputError(f"{file}: this is no report of close-loop; give its report.json, its folder, or a dataset.") from None


def _protocol(test: NextExperiment, dataset: Dataset, report: LoopReport) -> str:
    """A proposed test as a protocol that ``design-test`` takes, at the constants that were found."""
    first = dataset.curves[0]
    constants: dict[str, list[float]] = {}
    for (name, _), estimate in estimates(report.final.parameters).items():
        if name in ("C10_Pa", "C20_Pa") and estimate.value is not None:
            constants.setdefault(name, []).append(estimate.value)
    tables: dict[str, dict[str, object]] = {
        "constants": {name: float(np.mean(values)) for name, values in constants.items()},
        "specimen": test.specimen or {"shape": "point"},
        "tool": test.tool or {},
        "noise": first.noise.model_dump(mode="json", exclude_none=True),
    }
    lines = [f"# {test.protocol}", 'format = "explicitfe-protocol/1"', f"title = {toml_value(str(test.protocol))}"]
    lines += [f"test = {toml_value(dataset.test)}"]
    for name, table in tables.items():
        if table or name == "noise":
            lines += ["", f"[{name}]", *(f"{key} = {toml_value(value)}" for key, value in table.items())]
    for number in range(test.repeats or 1):
        lines += ["", "[[curve]]", f'id = "proposed-{number + 1}"']
        lines += [f"programme = [{', '.join(f'[{t:.6g}, {x:.9g}]' for t, x in test.programme)}]"]
        if test.conditions:
            lines += [f"conditions = {toml_value(test.conditions)}"]
    return "\n".join(lines) + "\n"
