"""``explicitfe.run``, ``explicitfe.resume`` and ``explicitfe.save``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from explicitfe.app.api.source import folder_of, path_of
from explicitfe.platform.errors import InputError, Progress, shortened, silent

if TYPE_CHECKING:
    from explicitfe.app.api.open_result import NotebookResult
    from explicitfe.fem.solve.simulation import Simulation


class RunResult(dict[str, object]):
    """The summary of a run, with the keys of ``explicitfe run --json``, and the way to its result.

    Every function that takes a result takes it: ``fe.measure(fe.run("vowel-i"))``.
    """

    @property
    def path(self) -> Path:
        """The result file."""
        return Path(str(self["result"]))

    @property
    def finished(self) -> bool:
        """Whether the run reached its end; otherwise ``self["message"]`` says why not."""
        return self["status"] == "finished"

    def open(self) -> NotebookResult:
        """Open the result; see :func:`open_result`."""
        from explicitfe.app.api.open_result import open_result

        return open_result(self)

    def __repr__(self) -> str:
        lines = [f"{self.get('title')}: {self['status']} in {self['wall_s']:.1f} s", f"  result: {self['result']}"]
        if self["message"]:
            lines.append(f"  {self['message']}")
        probes = self.get("probes")
        for name, end in probes.items() if isinstance(probes, Mapping) else ():
            lines.append(f"  {name}: {end['forward_mm']:.2f} mm forward, {end['up_mm']:.2f} mm up at the end")
        warnings = self["warnings"]
        lines += [f"  warning: {text}" for text in (warnings if isinstance(warnings, list) else ())]
        return "\n".join(lines)

    def _repr_html_(self) -> str | None:
        """The report page in a frame, for notebooks."""
        with self.open() as result:
            return result._repr_html_()


def run(
    scenario: Path | str,
    out: Path | str = "outputs",
    *,
    name: str | None = None,
    settings: Sequence[str] | Mapping[str, object] = (),
    overwrite: bool = False,
    resume: bool = False,
    progress: Progress = silent,
) -> RunResult:
    """Run a scenario to its end and store its result.

    The first run on a machine compiles the kernels, which takes a minute or two; ``explicitfe warmup`` does it beforehand.

    Parameters
    ----------
    scenario : scenario file, or a name of ``explicitfe list scenarios``, such as "vowel-i".
    out : output folder, created if it does not exist.
    name : name of the result; by default that of the scenario.
    settings : values that replace those of the scenario: ``{"model.resolution": "coarse"}``, or a list of texts
        ``"model.resolution=coarse"``.
    overwrite : replace an existing result.
    resume : continue an interrupted run of this scenario; without one, begin a new run.
    progress : called with the stage and the share of it that is done.

    Returns
    -------
    The summary, a dictionary with ``path``, ``finished`` and ``open()``. If the run ended early, ``status`` and ``message`` say
    why, and what was computed until then is stored. Ctrl-C ends a run after a sample, with the status "interrupted".

    Raises
    ------
    InputError : nothing was run and nothing was written.
    """
    from explicitfe.simulate.run.run import run as run_scenario
    from explicitfe.simulate.scenario.read import setting_texts

    if name is not None and not isinstance(name, str):
        raise InputError(f"run: name must be a text, not {shortened(repr(name))}.")
    folder, texts = folder_of(out, "run: out"), setting_texts(settings)
    return RunResult(
        run_scenario(scenario, folder, name=name, settings=texts, overwrite=overwrite, resume=resume, progress=progress)
    )


def save(
    simulation: Simulation,
    path: Path | str,
    *,
    duration_s: float,
    every_s: float = 1e-3,
    step_s: float | None = None,
    title: str = "A model built in Python",
    overwrite: bool = False,
    progress: Progress = silent,
) -> RunResult:
    """Run a simulation of a model that was built in Python, and store its result as that of a scenario.

    Parameters
    ----------
    simulation : at time 0.
    path : result file; ".vtkhdf" is appended if it is missing, and the folder is created.
    duration_s : simulated time, s.
    every_s : time between samples, s.
    step_s : a fixed time step, s; by default the largest stable step.
    title : heading of tables and pictures.
    overwrite : replace an existing result.
    progress : called with the stage and the share of it that is done.

    Returns
    -------
    The summary, as :func:`run` returns it; :func:`open_result`, :func:`measure`, :func:`plot` and :func:`report` take it. Such a
    run cannot be resumed, because no scenario describes its model.

    Raises
    ------
    InputError : a value is out of range, or the file exists or cannot be written.
    """
    from explicitfe.simulate.run.save import save as save_run

    return RunResult(
        save_run(
            simulation,
            folder_of(path, "save: path"),
            duration_s=duration_s,
            every_s=every_s,
            step_s=step_s,
            title=title,
            overwrite=overwrite,
            progress=progress,
        )
    )


def resume(result: Path | str, *, overwrite: bool = False, threads: int | None = None, progress: Progress = silent) -> RunResult:
    """Resume an interrupted run. The result is bitwise identical to that of an uninterrupted run.

    With another number of threads, or on another machine, it is identical up to rounding. A finished run is not changed.

    Parameters
    ----------
    result : the interrupted result, ``NAME.running.vtkhdf``, or its name in the folder ``outputs``.
    overwrite : replace a finished result that has the final name of this run.
    threads : number of threads; by default as before.
    progress : called with the stage and the share of it that is done.

    Raises
    ------
    InputError : the file is no result, is being written, belongs to a run that failed, or its model cannot be built again
        identically.
    """
    from explicitfe.simulate.run.resume import resume as resume_run

    path = result if isinstance(result, Path | str) else path_of(result)
    return RunResult(resume_run(path, overwrite=overwrite, threads=threads, progress=progress))
