"""``explicitfe new dataset`` and ``explicitfe new scenario``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer
from rich.markup import escape
from rich.table import Table

from explicitfe.cli import asking
from explicitfe.cli.answer import console, print_answer
from explicitfe.cli.completion import complete_shipped, complete_table, complete_words
from explicitfe.cli.options import JsonOption
from explicitfe.errors import InputError, nearest
from explicitfe.view.progress import following

if TYPE_CHECKING:
    from collections.abc import Sequence

    from explicitfe.measured.export import Export
    from explicitfe.measured.new_dataset import Strip
    from explicitfe.measured.quantities import Choice, Quantity
    from explicitfe.measured.tables import RawTable, TestKind

TESTS = ("compression", "indentation", "tension", "shear")
# Test -> the tool that it usually has.
USUAL_TOOLS = {"compression": "platen", "indentation": "flat-cylinder", "tension": "clamps"}
TOOLS = ("platen", "flat-cylinder", "sphere", "bonded-disc", "clamps")
CONTROLS, BASES = ("displacement", "force"), ("unknown", "bonded", "frictionless")
ROWS_SHOWN = 3


def _column(quantity: str) -> typer.models.OptionInfo:
    return typer.Option(f"--{quantity}", metavar="COLUMN[:UNIT]", help=f"Column of the {quantity.replace('-', ' ')}.")


def _size(words: str) -> typer.models.OptionInfo:
    return typer.Option(metavar="MM", help=words)


def new_dataset(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="Tables of your machine, one a test (.csv, .txt). To try it: gel-slow.csv gel-medium.csv gel-fast.csv",
            show_default=False,
            autocompletion=complete_table,
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder of the dataset; named after the files if left out.")
    ] = None,
    test: Annotated[str | None, typer.Option("--test", help=" | ".join(TESTS), autocompletion=complete_words(TESTS))] = None,
    time: Annotated[str | None, _column("time")] = None,
    displacement: Annotated[str | None, _column("displacement")] = None,
    force: Annotated[str | None, _column("force")] = None,
    stretch: Annotated[str | None, _column("stretch")] = None,
    stress: Annotated[str | None, _column("stress")] = None,
    shear_strain: Annotated[str | None, _column("shear-strain")] = None,
    shear_stress: Annotated[str | None, _column("shear-stress")] = None,
    diameter_mm: Annotated[float | None, _size("Diameter of a specimen that is a cylinder.")] = None,
    height_mm: Annotated[float | None, _size("Its height, along the load.")] = None,
    size_mm: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="Sizes of a specimen that is a block, the last along the load.")
    ] = None,
    base: Annotated[str, typer.Option(help=f"Face on which it stands: {' | '.join(BASES)}")] = "unknown",
    tool: Annotated[str | None, typer.Option("--tool", help=" | ".join(TOOLS), autocompletion=complete_words(TOOLS))] = None,
    tool_diameter_mm: Annotated[float | None, _size("Diameter of the tool.")] = None,
    control: Annotated[str, typer.Option(help=f"What the machine imposed: {' | '.join(CONTROLS)}")] = "displacement",
    friction: Annotated[str, typer.Option(help="Of the tool on the specimen: a coefficient | stick | unknown")] = "unknown",
    length_mm: Annotated[float | None, _size("Free length of a strip between clamps.")] = None,
    area_mm2: Annotated[float | None, typer.Option(metavar="MM2", help="Cross-section of the strip.")] = None,
    rate: Annotated[
        float | None,
        typer.Option("--rate", metavar="PER_S", help="Where no column is the time: pace of what was imposed, in mm/s or N/s."),
    ] = None,
    force_sd_N: Annotated[
        float | None, typer.Option("--force-sd-N", metavar="N", help="Noise of the force, a standard deviation; else estimated.")
    ] = None,
    contact_force_N: Annotated[
        float | None, typer.Option("--contact-force-N", metavar="N", help="Leave out the rows before the force reaches this.")
    ] = None,
    one_specimen: Annotated[
        bool | None, typer.Option("--one-specimen/--a-specimen-each", help="Whether all files are of one specimen.")
    ] = None,
    title: Annotated[str | None, typer.Option("--title", help="Heads tables and pictures.")] = None,
    source: Annotated[str, typer.Option("--source", help="Who measured it, where it is published.")] = "",
    license_: Annotated[str, typer.Option("--license", help="Under which it may be used.")] = "",
    as_json: JsonOption = False,
) -> None:
    """Make a dataset of tables that a testing machine exported: which column is what, in which unit, on what specimen.

    At a terminal it asks for what it cannot see in the files; a script gives options.

    Example: [bold]explicitfe new dataset my-test.csv --test compression --diameter-mm 25 --height-mm 15[/bold]
    """
    columns = {
        "time": time, "displacement": displacement, "force": force, "stretch": stretch, "stress": stress,
        "shear-strain": shear_strain, "shear-stress": shear_stress,
    }  # fmt: skip
    with following(console, f"reading {', '.join(map(str, files))}"):
        from explicitfe.host.shipped import export_file
        from explicitfe.measured.export import read_export
        from explicitfe.measured.new_dataset import TestDescription, quantities_of, usual_folder, write_new_dataset
        from explicitfe.view.terminal.dataset import new_dataset_table

        exports = [read_export(export_file(file)) for file in files]
    if asking.somebody_is_there():
        _show(exports[0])
    kind = cast("TestKind", _word(test, TESTS, "--test", "What was done", "compression"))
    with_tool = kind != "shear" and stretch is None and stress is None and not _only_stress(exports[0], kind)
    shape = _tool_shape(kind, tool) if with_tool else ""
    by_clamps = shape == "clamps"
    quantities = quantities_of(kind, with_tool)
    rate = _rate(rate, exports[0], time)
    sources: dict[Path, Sequence[Choice]] = {}
    stated = columns
    for export in exports:
        choices = [_choice(export, quantity, stated[quantity]) for quantity in quantities[rate is not None :]]
        sources[export.path] = choices
        # What was answered for one file holds for the next one, where it has such columns.
        stated = columns | {choice.quantity: f"{choice.column.name}:{choice.unit}" for choice in choices}
    description = TestDescription(
        test=kind,
        title=title or f"{kind.capitalize()} of {(out or usual_folder(files)).name}",
        specimen=_specimen(with_tool and not by_clamps, diameter_mm, height_mm, size_mm, base),
        tool=_tool(shape, tool_diameter_mm, control, friction) if with_tool and not by_clamps else None,
        rate_per_s=rate,
        strip=_strip(length_mm, area_mm2) if by_clamps else None,
        noise={} if force_sd_N is None else {"force_sd_N": force_sd_N},
        source=source,
        license=license_,
        contact_force_N=contact_force_N,
        one_specimen=_one_specimen(one_specimen, len(files)),
    )
    dataset = write_new_dataset(out or usual_folder(files), sources, description)
    print_answer(dataset, as_json, lambda: new_dataset_table(dataset), dataset["notes"])
    if not as_json:
        _next(f"explicitfe check {dataset['dataset']}", f"explicitfe close-loop {dataset['dataset']}")


def _show(export: Export) -> None:
    """What a file holds, so that its user can say which column is what."""
    for line in export.head[:8]:
        console.print(f"  {line}", style="dim", markup=False, highlight=False, overflow="ellipsis", no_wrap=True)
    table = Table(title=escape(str(export.path.name)), title_justify="left")
    for column in export.columns:
        table.add_column(escape(column.name + (f" [{column.unit}]" if column.unit else "")), justify="right")
    for row in range(min(ROWS_SHOWN, len(export.columns[0].values))):
        table.add_row(*(f"{column.values[row]:.6g}" for column in export.columns))
    console.print(table)


def _only_stress(export: Export, kind: str) -> bool:
    """Whether a file of compression or tension has a stress and no force."""
    from explicitfe.measured.quantities import guessed

    return kind != "indentation" and guessed(export, "force") is None and guessed(export, "stress") is not None


def _choice(export: Export, quantity: Quantity, stated: str | None) -> Choice:
    """The column that is a quantity, with its unit: as stated, by its name, or as a person says."""
    from explicitfe.measured.new_dataset import missing
    from explicitfe.measured.quantities import QUANTITIES, Choice, chosen, guessed, unit_of

    column, unit = None, None
    if stated is not None:
        column, unit = chosen(export, quantity, stated)
    else:
        column = guessed(export, quantity)
        unit = None if column is None else unit_of(quantity, column.unit)
    units = list(QUANTITIES[quantity].units)
    if (column is None or unit is None) and not asking.somebody_is_there():
        raise missing(export, quantity)
    if column is None:
        names = ", ".join(f"{k + 1} {column.name}" for k, column in enumerate(export.columns))
        column = asking.ask(f"Which column is the {quantity} ({names})", export.column)
        unit = unit_of(quantity, column.unit)

    def read_unit(word: str) -> str:
        known = unit_of(quantity, word)
        if known is None:
            raise InputError(f"please answer: {', '.join(units)}.")
        return known

    if unit is None:
        unit = asking.ask(f'Unit of "{column.name}" ({", ".join(units)})', read_unit, units[0])
    return Choice(column, quantity, unit)


def _word(given: str | None, words: Sequence[str], option: str, question: str, usual: str) -> str:
    """One of a few words: as given, or as a person says."""
    if given is None:
        if not asking.somebody_is_there():
            raise InputError(f"{option} is missing; give one of {', '.join(words)}.")
        return asking.ask(f"{question} ({', '.join(words)})", asking.one_of(words), usual)
    if given not in words:
        raise InputError(f'{option} "{given}" is not possible; {nearest(given, words)}')
    return given


def _length(given: float | None, option: str, question: str) -> float:
    if given is None:
        if not asking.somebody_is_there():
            raise InputError(f"{option} is missing: {question[0].lower()}{question[1:]}.")
        return asking.ask(question, asking.a_number)
    return given


def _specimen(with_tool: bool, diameter_mm: float | None, height_mm: float | None, size_mm: str | None, base: str) -> RawTable:
    """The table of what was tested."""
    if not with_tool:
        return {"shape": "point"}
    _word(base, BASES, "--base", "", "")
    if size_mm is not None and (diameter_mm is not None or height_mm is not None):
        raise InputError("give --diameter-mm and --height-mm (a cylinder) or --size-mm (a block), not both.")
    shape = "block" if size_mm is not None else "cylinder"
    if size_mm is None and diameter_mm is None and asking.somebody_is_there():
        shape = asking.ask("Shape of the specimen (cylinder, block)", asking.one_of(("cylinder", "block")), "cylinder")
    if shape == "cylinder":
        diameter_mm = _length(diameter_mm, "--diameter-mm", "Diameter of the specimen in mm (of a block: --size-mm)")
        height_mm = _length(height_mm, "--height-mm", "Height of the specimen in mm")
        return {"shape": "cylinder", "radius_mm": 0.5 * diameter_mm, "height_mm": height_mm, "base": base}
    return {"shape": "block", "size_mm": _three(size_mm), "base": base}


def _three(given: str | None) -> list[float]:
    """Three sizes."""

    def read(line: str) -> list[float]:
        numbers = [asking.a_number(word) for word in line.replace(",", " ").replace("x", " ").split()]
        if len(numbers) != 3:
            raise InputError("please give three numbers in mm, such as 20,20,10.")
        return numbers

    return asking.ask("Sizes of the block in mm, the last along the load (20,20,10)", read) if given is None else read(given)


def _tool_shape(kind: str, shape: str | None) -> str:
    """What pressed or pulled; clamps pull only."""
    if shape is None and kind == "compression":
        return "platen"
    shape = _word(shape, TOOLS, "--tool", "Tool", USUAL_TOOLS[kind])
    if shape == "clamps" and kind != "tension":
        raise InputError(f"--tool clamps is for --test tension; what pressed in this {kind}?")
    return shape


def _strip(length_mm: float | None, area_mm2: float | None) -> Strip:
    """The sizes of a strip between clamps."""
    from explicitfe.measured.new_dataset import Strip

    return Strip(
        _length(length_mm, "--length-mm", "Free length of the strip between the clamps in mm"),
        _length(area_mm2, "--area-mm2", "Cross-section of the strip in mm2"),
    )


def _rate(given: float | None, export: Export, time: str | None) -> float | None:
    """The pace of what was imposed, where no column is the time."""
    from explicitfe.measured.quantities import guessed

    if given is not None and not given > 0.0:
        raise InputError(f"--rate {given:g} is not possible; give a number above 0.")
    if given is not None or time is not None or guessed(export, "time") is not None or not asking.somebody_is_there():
        return given
    if asking.ask("Is there a column of the time (yes, no)", asking.yes_or_no, "yes"):
        return None
    return asking.ask("Pace of what the machine imposed, in mm/s or N/s", asking.a_number)


def _tool(shape: str, diameter_mm: float | None, control: str, friction: str) -> RawTable:
    """The table of what pressed or pulled."""
    _word(control, CONTROLS, "--control", "", "")
    table: RawTable = {"shape": shape}
    if shape != "platen":
        table["radius_mm"] = 0.5 * _length(diameter_mm, "--tool-diameter-mm", "Diameter of the tool in mm")
    try:
        coefficient: object = float(friction)
    except ValueError:
        coefficient = _word(friction, ("unknown", "stick"), "--friction", "", "")
    return table | {"control": control, "friction": coefficient}


def _one_specimen(given: bool | None, files: int) -> bool:
    if given is None and files > 1 and asking.somebody_is_there():
        return asking.ask("Are all files of one and the same specimen (yes, no)", asking.yes_or_no, "yes")
    return bool(given)


def _next(*commands: str) -> None:
    """What can be done now."""
    console.print("next:", highlight=False)
    for command in commands:
        console.print(f"  {command}", markup=False, highlight=False, soft_wrap=True)


def new_scenario(
    file: Annotated[Path, typer.Argument(help="The file to write (.toml).", show_default=False)],
    muscles: Annotated[
        list[str] | None,
        typer.Option("--muscle", metavar="NAME=FORCE", help="Muscle that pulls, and its force in N; repeat for more."),
    ] = None,
    duration_ms: Annotated[float, typer.Option("--duration-ms", metavar="MS", help="Time that is computed.")] = 200.0,
    like: Annotated[
        str | None,
        typer.Option(
            "--like",
            metavar="NAME",
            help="Copy one that `explicitfe list scenarios` shows.",
            autocompletion=complete_shipped,
        ),
    ] = None,
    title: Annotated[str | None, typer.Option("--title", help="Heads tables and pictures.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Write a scenario to begin with: muscles of the tongue that pull between palate and jaw, or a copy of one that is there.

    Example: [bold]explicitfe new scenario raise.toml --muscle STY=1 --muscle GGp=0.5[/bold]
    """
    if like is not None and muscles:
        raise InputError("give --muscle or --like, not both; the muscles of a copy are changed in its file.")
    with following(console, f"writing {file}"):
        from explicitfe.run.new_scenario import muscles_of_the_tongue, parsed_forces, write_new_scenario
        from explicitfe.view.terminal.program import new_scenario_table

        actions = {} if like is not None else muscles_of_the_tongue()
    words = " ".join(muscles or [])
    if like is None and not words and not asking.somebody_is_there():
        raise InputError("--muscle is missing; name a muscle with its force in N, such as --muscle GGp=2, or give --like.")
    if like is None and not words:
        for name, action in actions.items():
            console.print(f"  {name:6s}{action}", markup=False, highlight=False, soft_wrap=True)
        forces = asking.ask("Muscles that pull, with their forces in N (such as GGp=2 GGa=0.2)", parsed_forces)
    else:
        forces = parsed_forces(words) if like is None else {}
    if title is None and asking.somebody_is_there():
        title = asking.ask("Title", asking.some_text, file.stem)
    scenario = write_new_scenario(file, title=title, forces_N=forces, duration_ms=duration_ms, like=like)
    print_answer(scenario, as_json, lambda: new_scenario_table(scenario))
    if not as_json:
        _next(f"explicitfe check {scenario['scenario']}", f"explicitfe run {scenario['scenario']}")
