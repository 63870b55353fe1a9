"""``explicitfe design-test --propose``: the tests that settle best what a dataset leaves open, each as a protocol."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydantic import ValidationError

from explicitfe.close_loop.close import close_loop
from explicitfe.close_loop.report import SUMMARY
from explicitfe.errors import InputError, Progress, silent
from explicitfe.host.text import text_of
from explicitfe.host.toml_text import toml_value
from explicitfe.measured.curve import Dataset
from explicitfe.measured.read import read_dataset
from explicitfe.results.folder import checked_target, whole_folder
from explicitfe.results.loop_report import LoopReport, NextExperiment, estimates
from explicitfe.results.proposed_tests import ProposedTests

PROPOSALS_FILE = "proposed-tests.json"


def propose_tests(
    path: Path | str,
    *,
    out: Path | str | None = None,
    overwrite: bool = False,
    processes: int | None = None,
    progress: Progress = silent,
) -> ProposedTests:
    """The tests from which most is expected to be learned in a minute, by a report of ``close-loop`` or from a dataset.

    Parameters
    ----------
    path : report.json or its folder; or a dataset, on which the loop is closed first.
    out : folder for proposed-tests.json and a protocol of each test; nothing is written if left out.
    overwrite : replace an earlier answer.

    Raises
    ------
    InputError : a dataset or a report that cannot be used, or a folder that cannot be written.
    """
    target = None if out is None else checked_target(Path(out), overwrite, summary=PROPOSALS_FILE, what="proposal")
    path = Path(path)
    file = path / SUMMARY if path.is_dir() and (path / SUMMARY).is_file() else path
    report = _read(file) if file.suffix == ".json" else close_loop(path, processes=processes, progress=progress)
    proposed = ProposedTests(
        dataset=report.dataset or "",
        file=str(report.provenance.get("dataset", "")),
        verdict=report.verdict or "failed",
        sure=report.sure,
        posterior=report.posterior,
        tests=report.proposed_tests,
    )
    if target is None:
        return proposed
    dataset = read_dataset(proposed.file)
    names = [f"test-{number}.toml" for number in range(1, len(proposed.tests) + 1)]
    proposed = proposed.model_copy(update={"files": [str(target / name) for name in (PROPOSALS_FILE, *names)]})
    with whole_folder(target, summary=PROPOSALS_FILE) as folder:
        for name, test in zip(names, proposed.tests, strict=True):
            (folder / name).write_text(_protocol(test, dataset, report), encoding="utf-8")
        (folder / PROPOSALS_FILE).write_text(proposed.text, encoding="utf-8")
    return proposed


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
