"""The commands in the order of ``explicitfe --help``, and the options of ``explicitfe`` itself.

A new command is a module ``cli/<command>.py`` with one function, and a line here under the panel that it belongs to.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import typer

from explicitfe import __version__
from explicitfe.app.cli.bench import bench
from explicitfe.app.cli.check import check
from explicitfe.app.cli.close_loop import close_loop
from explicitfe.app.cli.compare import compare
from explicitfe.app.cli.design_test import design_test
from explicitfe.app.cli.doctor import doctor
from explicitfe.app.cli.export import export
from explicitfe.app.cli.help import PlainCommand, PlainGroup
from explicitfe.app.cli.identify import identify
from explicitfe.app.cli.inspect import inspect
from explicitfe.app.cli.list import list_
from explicitfe.app.cli.measure import measure
from explicitfe.app.cli.new import new_scenario
from explicitfe.app.cli.new_dataset import new_dataset
from explicitfe.app.cli.new_model import new_model
from explicitfe.app.cli.plot import plot
from explicitfe.app.cli.predict import predict
from explicitfe.app.cli.report import report
from explicitfe.app.cli.resume import resume
from explicitfe.app.cli.run import run
from explicitfe.app.cli.schema import schema
from explicitfe.app.cli.streams import stdout
from explicitfe.app.cli.sweep import sweep
from explicitfe.app.cli.verify import verify
from explicitfe.app.cli.view import view
from explicitfe.app.cli.warmup import warmup
from explicitfe.platform.host.code_cache import check_environment

Command = Callable[..., None]

# Panel of the help -> name of a command -> its function.
COMMANDS: dict[str, dict[str, Command]] = {
    "Scenarios": {"run": run, "sweep": sweep, "resume": resume, "check": check},
    "Results": {
        "inspect": inspect,
        "measure": measure,
        "view": view,
        "plot": plot,
        "compare": compare,
        "report": report,
        "export": export,
    },
    "Measured data": {"identify": identify, "predict": predict, "close-loop": close_loop, "design-test": design_test},
    "The program": {"doctor": doctor, "list": list_, "schema": schema, "warmup": warmup, "bench": bench, "verify": verify},
}
# Panel -> name of a group -> its help and its commands.
GROUPS: dict[str, dict[str, tuple[str, dict[str, Command]]]] = {
    "Scenarios": {
        "new": (
            "Create a scenario, a model of your own mesh, or a dataset.",
            {"scenario": new_scenario, "model": new_model, "dataset": new_dataset},
        )
    },
}

app = typer.Typer(
    cls=PlainGroup,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


EXAMPLES = """Examples:

[bold]explicitfe run vowel-i[/bold]

[bold]explicitfe report vowel-i[/bold]

[bold]explicitfe identify gel[/bold]

Exit codes: 0 done, 2 invalid input, 3 stopped early; all are in docs/reference/commands.md."""


def _print_version(wanted: bool) -> None:
    if wanted:
        stdout.write(f"{__version__}\n")
        raise typer.Exit()


@app.callback(epilog=EXAMPLES)
def _root(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.", is_eager=True, callback=_print_version)
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Print the traceback of an error.", envvar="EXPLICITFE_DEBUG")] = False,
) -> None:
    """Simulate the tongue with explicit-dynamics finite elements.

    A scenario file defines a run; the result file opens in ParaView. The first run of each kind of model compiles kernels;
    `explicitfe warmup` compiles them in advance.
    """
    check_environment()


for panel, commands in COMMANDS.items():
    for name, function in commands.items():
        app.command(name, cls=PlainCommand, rich_help_panel=panel)(function)
for panel, groups in GROUPS.items():
    for name, (words, commands) in groups.items():
        group = typer.Typer(cls=PlainGroup, help=words)
        for inner, function in commands.items():
            group.command(inner, cls=PlainCommand)(function)
        app.add_typer(group, name=name, rich_help_panel=panel)
