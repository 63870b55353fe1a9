"""From a scenario file to an analysis that is built, not yet compiled or run: here a scenario finds its kind of analysis."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from explicitfe.platform.errors import InputError
from explicitfe.platform.host import stopping
from explicitfe.platform.host.shipped import scenario_file
from explicitfe.simulate.run.analysis import Analysis
from explicitfe.simulate.run.indentation import IndentationAnalysis
from explicitfe.simulate.run.notes import mesh_notes
from explicitfe.simulate.run.transient import TransientAnalysis
from explicitfe.simulate.scenario.indentation import IndentationScenario
from explicitfe.simulate.scenario.read import Scenario, read_scenario
from explicitfe.simulate.scenario.transient import TransientScenario

# The kinds of analysis: what a scenario says -> how it is computed.
ANALYSES: dict[type, type[Analysis[Any, Any]]] = {
    TransientScenario: TransientAnalysis,
    IndentationScenario: IndentationAnalysis,
}


def prepare(path: Path | str, settings: Sequence[str] = (), notes: Sequence[str] = ()) -> Analysis[Any, Any]:
    """Read, check and build a scenario.

    Parameters
    ----------
    path : scenario file, or the name of a scenario that comes with the program.
    settings : ``key=value`` pairs that replace what the file says.
    notes : sentences for the user that the summary of a run begins its warnings with.

    Raises
    ------
    InputError : what is wrong with it, in one sentence.
    Stopped : a signal has asked to stop meanwhile.
    """
    begin = time.perf_counter()
    path = scenario_file(path)
    analysis = analysis_of(path, *read_scenario(path, settings))
    stopping.check()
    said = (*notes, *mesh_notes(analysis.model, built_in=analysis.built_in), *analysis.notes)
    stopping.check()
    return replace(analysis, notes=said, prepare_s=time.perf_counter() - begin)


def analysis_of(path: Path, scenario: Scenario, text: str) -> Analysis[Any, Any]:
    """Build a scenario that has been read from a file; InputError says what is wrong with it."""
    try:
        return ANALYSES[type(scenario)].prepare(path, scenario, text)
    except InputError as error:
        raise InputError(str(error) if str(error).startswith(str(path.parent)) else f"{path}: {error}") from None
