"""The command ``explicitfe``: what a person types, what they see while they wait, what a program reads.

Words for people go to stderr through rich; ``--json`` prints one object on stdout and nothing else there. Exit code 0: done;
1: the run ended early (what it computed is stored); 2: the input cannot be used; 130: stopped by hand.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console, RenderableType
from rich.markup import escape

from explicitfe import __version__
from explicitfe.errors import InputError, RunError
from explicitfe.view.json_text import json_text
from explicitfe.view.progress import following

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
_console = Console(stderr=True)

_Scenario = Annotated[Path, typer.Argument(help="Scenario file (TOML).", show_default=False)]
_Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Replace a value of the scenario; repeat for more."),
]
_Tissue = Annotated[
    Path | None,
    typer.Option(
        "--tissue", metavar="MODEL", help="Model file whose constants and effects replace the scenario's.", show_default=False
    ),
]
_TissueGroup = Annotated[
    str | None,
    typer.Option("--tissue-group", metavar="NAME", help="Group of its constants, if there are several.", show_default=False),
]
_Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout, nothing else there.")]
_Out = Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder of the result.")]


@app.callback(invoke_without_command=True)
def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version and leave.", is_eager=True)] = False,
) -> None:
    """Explicit-dynamics simulator of the tongue: from a scenario file to a result file that ParaView opens.

    Example: [bold]explicitfe run scenarios/vowel-i.toml[/bold]
    """
    if version:
        print(__version__)
        raise typer.Exit()


@app.command()
def run(
    scenario: _Scenario,
    out: _Out = Path("outputs"),
    settings: _Settings = None,
    tissue: _Tissue = None,
    tissue_group: _TissueGroup = None,
    plots: Annotated[bool, typer.Option("--plots", help="Draw the run as PNG beside the result.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a result that exists.")] = False,
    as_json: _Json = False,
) -> None:
    """Run a scenario and store its result as one .vtkhdf file.

    Example: [bold]explicitfe run scenarios/vowel-i.toml --set muscle.GGp.force_N=1.5 --out outputs --plots[/bold]
    """
    from explicitfe.run.prepare import prepare
    from explicitfe.run.run import result_path

    tissue_settings, notes = _tissue(scenario, tissue, tissue_group)
    with following(_console) as progress:
        analysis = prepare(scenario, [*tissue_settings, *(settings or ())], notes)
        summary = analysis.run(result_path(scenario, out), overwrite=overwrite, progress=progress)
        if plots:
            progress("draw", 0.0)
            summary["plots"] = [str(path) for path in analysis.draw(Path(summary["result"]))]
            progress("draw", 1.0)
    _answer(summary, as_json, lambda: analysis.table(summary), summary["warnings"])
    if summary["status"] != "finished":
        _console.print(f"[red]{summary['status']}[/red]: {escape(summary['message'])}", soft_wrap=True, highlight=False)
        raise typer.Exit(130 if summary["status"] == "interrupted" else 1)


@app.command()
def identify(
    dataset: Annotated[Path, typer.Argument(help="Folder of a dataset, or its dataset.toml.", show_default=False)],
    method: Annotated[
        str, typer.Option("--method", help="least-squares | paper (the iteration of Gérard et al. 2005)")
    ] = "least-squares",
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder for numbers, pictures and a scenario with the constants.")
    ] = None,
    fit: Annotated[
        list[str] | None,
        typer.Option(
            "--fit", metavar="KEY=VALUE", help="Fit only curves with this condition, predict the others; repeat for more."
        ),
    ] = None,
    constants_by: Annotated[
        str | None,
        typer.Option("--constants-by", metavar="KEY", help="Curves that agree in this condition share their constants."),
    ] = None,
    poisson: Annotated[float, typer.Option("--poisson", help="Poisson's ratio, supposed.")] = 0.499,
    refinement: Annotated[float, typer.Option("--refinement", help="Divides the element sizes of the forward model.")] = 1.5,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what an earlier identification wrote.")] = False,
    as_json: _Json = False,
) -> None:
    """Find the Yeoh constants of tissue from measured force-displacement curves.

    Example: [bold]explicitfe identify my-dataset --out fit[/bold]
    """
    from explicitfe.identify.identify import identify as identify_constants
    from explicitfe.view.terminal.identify import identification_notes, identification_tables

    with following(_console) as progress:
        identification = identify_constants(
            dataset,
            method=method,
            out=out,
            fit_where=fit or (),
            constants_by=constants_by,
            poisson=poisson,
            refinement=refinement,
            overwrite=overwrite,
            progress=progress,
        )
    _answer(identification, as_json, lambda: identification_tables(identification), list(identification_notes(identification)))
    if any(group.get("status") == "failed" for group in identification["groups"].values()):
        raise typer.Exit(1)


@app.command()
def predict(
    dataset: Annotated[Path, typer.Argument(help="Folder of a dataset, or its dataset.toml.", show_default=False)],
    model: Annotated[Path, typer.Option("--model", metavar="FILE", help="Constants and effects (TOML).", show_default=False)],
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Folder for the numbers and a CSV a curve.")] = None,
    curves: Annotated[
        list[str] | None, typer.Option("--curve", metavar="ID", help="Predict only this curve; repeat for more.")
    ] = None,
    refinement: Annotated[
        float | None, typer.Option("--refinement", help="Divides the element sizes; the model file's own if left out.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what an earlier prediction wrote.")] = False,
    as_json: _Json = False,
) -> None:
    """Predict measured curves from constants and effects, and say how far off they are.

    Example: [bold]explicitfe predict my-dataset --model model.toml[/bold]
    """
    from explicitfe.predict.predict import predict as predict_dataset
    from explicitfe.view.terminal.predict import prediction_table

    with following(_console) as progress:
        prediction = predict_dataset(
            dataset, model, out=out, curves=curves or (), refinement=refinement, overwrite=overwrite, progress=progress
        )
    failures = [f"{name}: {message}" for name, message in prediction.failures.items()]
    notes = failures + [f"assumed: {text}" for text in prediction.assumed]
    _answer(prediction.document, as_json, lambda: prediction_table(prediction), notes)
    if failures:
        raise typer.Exit(1)


@app.command("close-loop")
def close_loop(
    dataset: Annotated[Path, typer.Argument(help="Folder of a dataset, or its dataset.toml.", show_default=False)],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="DIR", help="Folder of the report; outputs/close-loop-NAME if left out.", show_default=False
        ),
    ] = None,
    holdout: Annotated[
        list[str] | None, typer.Option("--holdout", metavar="ID", help="Only predict this curve; repeat for more.")
    ] = None,
    constants_by: Annotated[
        str | None,
        typer.Option("--constants-by", metavar="KEY", help="Curves that agree in this condition share their constants."),
    ] = None,
    effects: Annotated[
        list[str] | None, typer.Option("--effects", metavar="NAME", help="Consider only this effect; repeat for more.")
    ] = None,
    max_effects: Annotated[int, typer.Option("--max-effects", help="Add no more effects, or terms of one, than this.")] = 3,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an earlier report.")] = False,
    as_json: _Json = False,
) -> None:
    """Say what a model lacks, given measured curves: trace the residual, add the effect, report the error before and after.

    Example: [bold]explicitfe close-loop my-dataset --out report[/bold]
    """
    from explicitfe.close_loop.close import close_loop as close
    from explicitfe.measured.files import folder_name
    from explicitfe.view.terminal.close_loop import loop_tables

    with following(_console) as progress:
        report = close(
            dataset,
            out=out or Path("outputs") / f"close-loop-{folder_name(dataset)}",
            holdout=holdout or (),
            constants_by=constants_by,
            effects=effects or (),
            max_effects=max_effects,
            overwrite=overwrite,
            progress=progress,
        )
    _answer(report.document, as_json, lambda: loop_tables(report), report.warnings)
    if report.verdict == "failed":
        raise typer.Exit(1)


@app.command("design-test")
def design_test(
    protocol: Annotated[Path, typer.Argument(help="Protocol file (TOML), see docs/close-loop.md.", show_default=False)],
    as_json: _Json = False,
) -> None:
    """Say which effects a planned test can find and tell apart, before anything is measured.

    Example: [bold]explicitfe design-test scenarios/protocols/gerard-2005.toml[/bold]
    """
    from explicitfe.close_loop.design import design_test as design
    from explicitfe.view.terminal.close_loop import design_table

    with following(_console) as progress:
        answer = design(protocol, progress=progress)
    _answer(answer.document, as_json, lambda: design_table(answer))


_blind = typer.Typer(no_args_is_help=True, help="Test close-loop on data with an undeclared effect in it.")
app.add_typer(_blind, name="blind")
_Cases = Annotated[Path, typer.Argument(help="Folder of the cases.", show_default=False)]


@app.command()
def check(
    scenario: _Scenario,
    settings: _Settings = None,
    tissue: _Tissue = None,
    tissue_group: _TissueGroup = None,
    as_json: _Json = False,
) -> None:
    """Validate and build a scenario without running it: mesh quality, stable step, steps, wall time, memory.

    Example: [bold]explicitfe check scenarios/vowel-i.toml --set model.resolution=fine[/bold]
    """
    from explicitfe.run.prepare import prepare

    tissue_settings, notes = _tissue(scenario, tissue, tissue_group)
    with following(_console) as progress:
        analysis = prepare(scenario, [*tissue_settings, *(settings or ())], notes)
        report = analysis.check(progress)
    _answer(report, as_json, lambda: analysis.check_table(report))
    for note in notes:
        _note(note)


@app.command()
def inspect(result: Annotated[Path, typer.Argument(help="Result file (.vtkhdf).")], as_json: _Json = False) -> None:
    """Show what a result holds: status, times, fields, energies, probes, provenance.

    Example: [bold]explicitfe inspect outputs/vowel-i.vtkhdf[/bold]
    """
    from explicitfe.measure.measure import measures_if_any
    from explicitfe.results import open_result
    from explicitfe.view.terminal.stored import result_table

    with open_result(result) as opened:
        held, measures = opened.contents(), measures_if_any(opened)
    answer = {**held, "measures": measures and measures.document}
    _answer(answer, as_json, lambda: result_table(held, measures), held["summary"].get("warnings", []))


@app.command()
def measure(
    results: Annotated[list[Path], typer.Argument(help="Result files (.vtkhdf).", show_default=False)],
    at_ms: Annotated[float | None, typer.Option("--at-ms", metavar="T", help="When; at the end if left out.")] = None,
    formants: Annotated[bool, typer.Option("--formants", help="Also the airway, and F1 to F3 (docs/airway.md).")] = False,
    as_json: _Json = False,
) -> None:
    """Measure what a tongue did: its points, grooves, constriction, contact, speeds (docs/measures.md).

    Example: [bold]explicitfe measure outputs/vowel-i.vtkhdf outputs/sl-alone.vtkhdf --at-ms 100[/bold]
    """
    from explicitfe.measure.measure import measure as measures_of_file
    from explicitfe.view.terminal.measures import measures_table

    measured = [measures_of_file(path, None if at_ms is None else 1e-3 * at_ms, formants) for path in results]
    _answer({"results": [measures.document for measures in measured]}, as_json, lambda: measures_table(measured))


@app.command("list")
def list_(
    what: Annotated[str, typer.Argument(help="models | muscles | scenarios | materials | effects", show_default=False)],
    as_json: _Json = False,
) -> None:
    """List what comes with the program.

    Example: [bold]explicitfe list muscles[/bold]
    """
    from explicitfe.errors import nearest
    from explicitfe.run.lists import LISTS
    from explicitfe.view.terminal.program import list_table

    if what not in LISTS:
        raise InputError(f'cannot list "{what}"; {nearest(what, LISTS)}')
    rows = LISTS[what]()
    _answer({what: rows}, as_json, lambda: list_table(what, rows))


@app.command()
def schema() -> None:
    """Print the JSON schema of scenario files, for editors that complete and check TOML.

    Example: [bold]explicitfe schema > scenario.schema.json[/bold]
    """
    from explicitfe.scenario.read import json_schema

    print(json_text(json_schema()))


@app.command()
def warmup(
    everything: Annotated[bool, typer.Option("--all", help="Also other elements, and tissue that relaxes.")] = False,
    as_json: _Json = False,
) -> None:
    """Make the machine code that runs need, now: the first run then need not wait for it.

    Example: [bold]explicitfe warmup[/bold]
    """
    from explicitfe.run.speed import warm
    from explicitfe.view.terminal.program import machine_code_table

    with following(_console) as progress:
        seconds_of = warm(everything, progress)
    _answer({"seconds": seconds_of}, as_json, lambda: machine_code_table(seconds_of))


@app.command()
def bench(
    sizes: Annotated[
        list[int] | None, typer.Option("--elements", help="Size of the block: 1000 | 30000 | 250000; repeat for more.")
    ] = None,
    as_json: _Json = False,
) -> None:
    """Time this machine: nanoseconds per element and step, beside what was measured for the documentation.

    Example: [bold]explicitfe bench --elements 1000 --elements 30000[/bold]
    """
    from explicitfe.run.speed import TIMED_SIZES
    from explicitfe.run.speed import bench as time_it
    from explicitfe.view.terminal.program import speed_tables

    with following(_console) as progress:
        speed = time_it(sizes or tuple(TIMED_SIZES), progress)
    _answer(speed, as_json, lambda: speed_tables(speed))


def _tissue(scenario: Path, model: Path | None, group: str | None) -> tuple[list[str], list[str]]:
    """Settings that put the tissue of a model file into a scenario, and notes of what it has and the run does not."""
    if model is None:
        if group is not None:
            raise InputError("--tissue-group names constants of a model file; give it with --tissue.")
        return [], []
    from explicitfe.predict.tissue_in_scenario import stored_tissue_settings

    return stored_tissue_settings(scenario, model, group)


@_blind.command("make")
def blind_make(
    folder: _Cases,
    seed: Annotated[int, typer.Option("--seed", help="Draws the cases.")],
    count: Annotated[int, typer.Option("--count", help="How many.")] = 20,
    family: Annotated[str, typer.Option("--family", help="homogeneous | indentation")] = "homogeneous",
    as_json: _Json = False,
) -> None:
    """Draw cases: datasets in FOLDER/cases, and what is hidden in them in FOLDER/sealed.

    Example: [bold]explicitfe blind make blind --seed 7 --count 20[/bold]
    """
    from explicitfe.blind.make import make

    with following(_console) as progress:
        cases = make(folder, seed=seed, count=count, family=family, progress=progress)
    if as_json:
        print(json_text(cases))
    else:
        _console.print(f"{cases['count']} cases in {escape(str(folder))}", highlight=False)


@_blind.command("score")
def blind_score(folder: _Cases, as_json: _Json = False) -> None:
    """Close the loop on every case that has no report yet, then open what was sealed and count.

    Example: [bold]explicitfe blind score blind[/bold]
    """
    from explicitfe.blind.score import score

    with following(_console) as progress:
        scores = score(folder, progress=progress)
    if as_json:
        print(json_text(scores))
    else:
        Console().print((folder / "score.md").read_text(encoding="utf-8"), markup=False, highlight=False)


def main() -> None:
    """Entry point of the command: errors become one sentence and an exit code."""
    # Products of matrices are small here: more threads would only wait for cores that are busy. In time, for nothing has
    # imported numpy yet, and for the processes that are started too.
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    try:
        app()
    except InputError as error:
        _console.print(f"[red]error:[/red] {escape(str(error))}", soft_wrap=True, highlight=False, markup=True)
        sys.exit(2)
    except RunError as error:
        _console.print(f"[red]failed:[/red] {escape(str(error))}", soft_wrap=True, highlight=False)
        sys.exit(1)
    except KeyboardInterrupt:
        _console.print("stopped by hand")
        sys.exit(130)


def _answer(value: object, as_json: bool, table: Callable[[], RenderableType], notes: Sequence[str] = ()) -> None:
    """Print what a command came to: as JSON for programs, or as a table with notes for people."""
    if as_json:
        print(json_text(value))
        return
    Console().print(table())
    for sentence in notes:
        _note(sentence)


def _note(sentence: str) -> None:
    _console.print(f"[yellow]note:[/yellow] {escape(sentence)}", soft_wrap=True, highlight=False)
