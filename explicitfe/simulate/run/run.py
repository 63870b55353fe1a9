"""Running a scenario file: read, build, compile, run, store, summarize."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from explicitfe.platform.errors import InputError, Progress, shortened, silent
from explicitfe.platform.host import stopping
from explicitfe.platform.host.result_files import OUTPUT_FOLDER, SUFFIX
from explicitfe.platform.host.shipped import scenario_file
from explicitfe.results.documents.run_summary import RunSummary
from explicitfe.simulate.run.prepare import prepare
from explicitfe.simulate.run.resume import resume_analysis, stored_before

# File systems allow 255 bytes; pictures and temporary files append to the name.
LONGEST_NAME_BYTES = 200


def result_path(scenario_path: Path | str, out: Path | str = OUTPUT_FOLDER, name: str | None = None) -> Path:
    """Path of the result of a scenario: it has the name of the scenario, or a name of its own.

    Raises
    ------
    InputError : the name cannot be the name of a file, or is longer than 200 bytes.
    """
    if name is None:
        name = scenario_file(scenario_path).stem
    elif not name or not name.isprintable() or name != Path(name).name or name.startswith("."):
        raise InputError(f'`name` "{shortened(name)}" cannot be the name of a file; use letters and digits, such as softer.')
    name = name.removesuffix(SUFFIX)
    size = len(os.fsencode(name))
    if size > LONGEST_NAME_BYTES:
        raise InputError(
            f'the name of the result, "{shortened(name)}", has {size} bytes; at most {LONGEST_NAME_BYTES} are possible: choose a '
            "shorter `name`."
        )
    return Path(out) / f"{name}{SUFFIX}"


def run(
    path: Path | str,
    out: Path | str = OUTPUT_FOLDER,
    *,
    name: str | None = None,
    settings: Sequence[str] = (),
    notes: Sequence[str] = (),
    overwrite: bool = False,
    resume: bool = False,
    progress: Progress = silent,
) -> RunSummary:
    """Run a scenario and store its result; see :func:`explicitfe.run`. ``notes`` are prepended to the warnings of the summary."""
    analysis, target = prepare(path, settings, notes), result_path(path, out, name)
    stored = stored_before(target) if resume else None
    if stored is not None:
        return resume_analysis(analysis, stored, overwrite=overwrite, progress=progress)
    with stopping.watching():
        return analysis.run(target, overwrite=overwrite, progress=progress)
