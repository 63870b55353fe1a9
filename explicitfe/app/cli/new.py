"""``explicitfe new scenario``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from explicitfe.app.cli import asking
from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.cli.completion import complete_shipped
from explicitfe.app.view.progress import following
from explicitfe.platform.errors import InputError


def print_next(*commands: str) -> None:
    """Print the commands that a user may run next."""
    console.print("next:", highlight=False)
    for line in commands:
        console.print(f"  {line}", markup=False, highlight=False, soft_wrap=True)


@command(completions={"like": complete_shipped})
def new_scenario(
    file: Path,
    *,
    muscles: Sequence[str] = (),
    duration_ms: float = 200.0,
    like: str | None = None,
    title: str | None = None,
    as_json: bool = False,
) -> None:
    """Write a scenario: active muscles of the tongue between palate and jaw, or a copy of a bundled scenario.

    Example: [bold]explicitfe new scenario raise.toml --muscle STY=1 --muscle GGp=0.5[/bold]

    Parameters
    ----------
    file : file to write (.toml).
    muscles : active muscle and its force in N.
    duration_ms : simulated time in ms.
    like : copy a bundled scenario, see ``explicitfe list scenarios``.
    title : title in tables and pictures.
    """
    if like is not None and muscles:
        raise InputError("--muscle and --like exclude each other; change the muscles of a copy in its file.")
    with following(console, f"writing {file}"):
        from explicitfe.app.tools.new_scenario import muscles_of_the_tongue, parsed_forces, write_new_scenario
        from explicitfe.app.view.terminal.program import new_scenario_table

        actions = {} if like is not None else muscles_of_the_tongue()
    words = " ".join(muscles)
    if like is None and not words and not asking.somebody_is_there():
        raise InputError("--muscle is missing; give a muscle and its force in N, such as --muscle GGp=2, or give --like.")
    if like is None and not words:
        for name, action in actions.items():
            console.print(f"  {name:6s}{action}", markup=False, highlight=False, soft_wrap=True)
        forces = asking.ask("Active muscles and their forces in N (such as GGp=2 GGa=0.2)", parsed_forces)
    else:
        forces = parsed_forces(words) if like is None else {}
    if title is None and asking.somebody_is_there():
        title = asking.ask("Title", asking.some_text, file.stem)
    scenario = write_new_scenario(file, title=title, forces_N=forces, duration_ms=duration_ms, like=like)
    print_answer(scenario, as_json, lambda: new_scenario_table(scenario))
    if not as_json:
        print_next(f"explicitfe check {scenario['scenario']}", f"explicitfe run {scenario['scenario']}")
