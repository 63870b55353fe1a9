"""``explicitfe new dataset``."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from rich.markup import escape
from rich.table import Table

from explicitfe.app.cli import asking
from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.cli.completion import complete_table, complete_words
from explicitfe.app.cli.new import print_next
from explicitfe.app.view.progress import following
from explicitfe.platform.errors import InputError, nearest, shortened
from explicitfe.platform.host.shipped import MARKER_SUFFIXES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from explicitfe.inverse.measured.columns import Choice
    from explicitfe.inverse.measured.export import Export
    from explicitfe.inverse.measured.new_dataset import NewDataset, Strip
    from explicitfe.inverse.measured.quantities import Quantity
    from explicitfe.inverse.measured.tables import RawTable, TestKind

TESTS = ("compression", "indentation", "tension", "equibiaxial", "planar", "shear", "trajectory")
TESTS_OF_LOOP = ("compression", "indentation", "tension", "shear")  # in which effects are sought
# Test -> its default tool.
USUAL_TOOLS = {"compression": "platen", "indentation": "flat-cylinder", "tension": "clamps", "planar": "clamps"}
TOOLS = ("platen", "flat-cylinder", "sphere", "bonded-disc", "clamps")
CONTROLS, BASES = ("displacement", "force"), ("unknown", "bonded", "frictionless")
ROWS_SHOWN = 3


# Options of one kind of test only.
OF_TRAJECTORIES = ("mapping", "fixed", "scenario", "unit", "rate_hz", "axes", "noise_mm", "interval_s")
COLUMN_OPTIONS = ("time", "displacement", "force", "stretch", "stress", "shear_strain", "shear_stress")
OF_SPECIMENS = ("tool", "diameter_mm", "height_mm", "size_mm", "force_sd_N", "rate", "contact_force_N")


@dataclass(frozen=True, kw_only=True)
class NewDatasetOptions:
    """Options of ``explicitfe new dataset``.

    Parameters
    ----------
    out : folder of the dataset; by default named after the files.
    test : kind of test: compression | indentation | tension | equibiaxial | planar | shear | trajectory; one for each file,
        separated by commas, for several homogeneous tests in one dataset.
    time, displacement, force, stretch, stress, shear_strain, shear_stress : column of this quantity, with its unit.
    diameter_mm : diameter of a cylindrical specimen.
    height_mm : height of the cylinder, along the load.
    size_mm : dimensions of a block; the last one is along the load.
    base : support of the specimen: unknown | bonded | frictionless.
    tool : shape of the tool: platen | flat-cylinder | sphere | bonded-disc | clamps.
    tool_diameter_mm : diameter of the tool.
    control : quantity that the machine imposed: displacement | force.
    friction : friction coefficient of the tool, or stick | unknown.
    length_mm : free length of a strip between clamps.
    area_mm2 : cross-section of the strip.
    rate : loading rate in mm/s or N/s, if there is no time column.
    force_sd_N : standard deviation of the force noise in N; by default estimated.
    contact_force_N : omit the rows before the force first reaches this value in N.
    one_specimen : all files come from one specimen or speaker, or each from another.
    mapping : trajectory: map a point of the scenario, or the position X,Y,Z in mm of a marker, to a sensor.
    fixed : trajectory: a marker that sits on what does not move.
    unit : trajectory: unit of columns that name none, or in place of that in the file.
    rate_hz : trajectory: sampling rate, if there is no time column.
    axes : trajectory: directions of x, y and z, such as front,left,up.
    noise_mm : trajectory: standard deviation of a coordinate in mm.
    interval_s : trajectory: rows to use; START is time 0 of the scenario.
    title : title in tables and pictures.
    source : who measured the data, and where they are published.
    license_ : license of the data.
    """

    out: Path | None = None
    test: str | None = None
    time: str | None = None
    displacement: str | None = None
    force: str | None = None
    stretch: str | None = None
    stress: str | None = None
    shear_strain: str | None = None
    shear_stress: str | None = None
    diameter_mm: float | None = None
    height_mm: float | None = None
    size_mm: str | None = None
    base: str = "unknown"
    tool: str | None = None
    tool_diameter_mm: float | None = None
    control: str = "displacement"
    friction: str = "unknown"
    length_mm: float | None = None
    area_mm2: float | None = None
    rate: float | None = None
    force_sd_N: float | None = None
    contact_force_N: float | None = None
    one_specimen: bool | None = None
    mapping: Sequence[str] = ()
    fixed: Sequence[str] = ()
    scenario: Path | None = None
    unit: str | None = None
    rate_hz: float | None = None
    axes: str | None = None
    noise_mm: float | None = None
    interval_s: str | None = None
    title: str | None = None
    source: str = ""
    license_: str = ""


@command(
    NewDatasetOptions,
    completions={"files": complete_table, "test": complete_words(TESTS), "tool": complete_words(TOOLS)},
    **{name: f"--{name.replace('_', '-')} COL[:UNIT]" for name in COLUMN_OPTIONS},
    fixed="--fixed SENSOR",
    interval_s="--interval-s START:END",
    license_="--license",
    one_specimen="--one-specimen/--a-specimen-each",
    scenario="--scenario SCENARIO",
    size_mm="--size-mm X,Y,Z",
)
def new_dataset(files: list[Path], *, as_json: bool = False, **given: Any) -> None:
    """Make a dataset from tables of a testing machine, or from recordings of sensors.

    Columns, units and signs are converted; notes list every change. At a terminal, the command asks for missing information.
    In a script, give options.

    Example: [bold]explicitfe new dataset my-test.csv --test compression --diameter-mm 25 --height-mm 15[/bold]

    Example: [bold]explicitfe new dataset coils.csv --test trajectory --map tip=TT --map dorsum=TD --scenario vowel-i[/bold]

    Example: [bold]explicitfe new dataset motion.c3d --test trajectory --map 100,15,36=M0 --map 6,-10,-1=M3 --map 6,40,0=M4
    --fixed M3 --fixed M4 --scenario beam-release[/bold]

    Parameters
    ----------
    files : tables (.csv, .txt) or recordings (.c3d, .trc, .sto, .pos, .mat), one per test. Bundled examples: gel-slow.csv
        gel-medium.csv gel-fast.csv ema-vowel-i.csv.
    scenario : trajectory: scenario to compare with.
    """
    options = NewDatasetOptions(**given)
    _check_words(options)
    columns = {name.replace("_", "-"): getattr(options, name) for name in COLUMN_OPTIONS}
    if options.test == TESTS[-1]:
        _refuse(options, (*COLUMN_OPTIONS, *OF_SPECIMENS), "is not for --test trajectory")
        with following(console, f"reading {', '.join(map(str, files))}"):
            from explicitfe.inverse.measured.coils import parse_interval, parse_mapping, read_coils
            from explicitfe.inverse.measured.new_dataset import usual_folder
            from explicitfe.inverse.measured.new_trajectory import TrajectoryDescription, write_new_trajectory
            from explicitfe.platform.host.shipped import export_file

            folder = options.out or usual_folder(files)
            trajectories = TrajectoryDescription(
                title=options.title or f"Recording of {folder.name}",
                mapping=parse_mapping(options.mapping),
                fixed=options.fixed,
                scenario=options.scenario,
                noise_mm=options.noise_mm,
                interval_s=None if options.interval_s is None else parse_interval(options.interval_s, "--interval-s"),
                one_speaker=bool(options.one_specimen),
                source=options.source,
                license=options.license_,
            )
            recordings = [
                read_coils(export_file(file), unit=options.unit, rate_hz=options.rate_hz, axes=options.axes) for file in files
            ]
            dataset = write_new_trajectory(folder, recordings, trajectories)
        _print(dataset, as_json)
        return
    _refuse(options, OF_TRAJECTORIES, "is for --test trajectory only")
    for file in files:
        if file.suffix.lower() in MARKER_SUFFIXES:
            raise InputError(f"{file}: a {file.suffix} file has positions of markers; add --test trajectory.")
    with following(console, f"reading {', '.join(map(str, files))}"):
        from explicitfe.inverse.measured.new_dataset import TestDescription, quantities_of, usual_folder, write_new_dataset
        from explicitfe.platform.host.shipped import export_file

        exports = [_beginning(export_file(file)) for file in files]
    if asking.somebody_is_there():
        _show(exports[0])
    words = [None] if options.test is None else options.test.split(",")
    tests = [cast("TestKind", _word(word, TESTS[:-1], "--test", "Test", "compression")) for word in words]
    if 1 != len(tests) != len(files):
        raise InputError(f"--test names {len(tests)} tests for {len(files)} files; give one test, or one for each file.")
    kind = tests[0]
    lacking: list[str] = []  # A script is told at once everything that it has to state.
    with_tool = len(set(tests)) == 1 and kind not in ("shear", "equibiaxial") and options.stretch is None
    with_tool = with_tool and options.stress is None and not _only_stress(exports[0], kind)
    shape = _tool_shape(kind, options.tool, lacking) if with_tool else ""
    by_clamps = shape == "clamps"
    rate = _rate(options.rate, exports[0], options.time)
    sources: list[tuple[Export, Sequence[Choice]]] = []
    stated = columns
    for export, test in zip(exports, tests if len(tests) > 1 else len(files) * tests, strict=True):
        quantities = quantities_of(test, with_tool)[rate is not None :]
        answers = [_choice(export, quantity, stated[quantity], lacking) for quantity in quantities]
        choices = [choice for choice in answers if choice is not None]
        sources.append((export, choices))
        # Answers for one file are used for the next one if it has such columns.
        if len(tests) == 1:
            stated = columns | {choice.quantity: f"{choice.column.name}:{choice.unit}" for choice in choices}
    of_tool = with_tool and not by_clamps
    description = TestDescription(
        test=kind,
        tests=tuple(tests) if len(tests) > 1 else (),
        title=options.title or f"{', '.join(tests).capitalize()} of {(options.out or usual_folder(files)).name}",
        specimen=_specimen(options, lacking) if of_tool else {"shape": "point"},
        tool=_tool(shape, options, lacking) if of_tool else None,
        rate_per_s=rate,
        strip=_strip(options.length_mm, options.area_mm2, lacking) if by_clamps else None,
        noise={} if options.force_sd_N is None else {"force_sd_N": options.force_sd_N},
        source=options.source,
        license=options.license_,
        contact_force_N=options.contact_force_N,
        one_specimen=_one_specimen(options.one_specimen, len(files)),
    )
    if lacking:
        names = ", ".join(f"{column.name} [{column.unit}]" if column.unit else column.name for column in exports[0].columns)
        texts = "".join(f'; "{shortened(name)}" has text, such as "{shortened(cell)}"' for name, cell in exports[0].texts.items())
        options_to_add = ", ".join(dict.fromkeys(lacking))
        raise InputError(f"{exports[0].path}: add {options_to_add}. Columns: {shortened(names)}{texts}.")
    with following(console, f"reading {', '.join(map(str, files))}"):
        sources = [_whole(export, choices) for export, choices in sources]
    _print(write_new_dataset(options.out or usual_folder(files), sources, description), as_json)


def _print(dataset: NewDataset, as_json: bool) -> None:
    from explicitfe.app.view.terminal.dataset import new_dataset_table

    print_answer(dataset, as_json, lambda: new_dataset_table(dataset), dataset["notes"])
    if not as_json:
        of_loop = ("close-loop",) if dataset["test"] in (*TESTS_OF_LOOP, TESTS[-1]) else ()
        commands = ("check", *(() if dataset["test"] == TESTS[-1] else ("identify",)), *of_loop)
        print_next(*(f"explicitfe {command} {dataset['dataset']}" for command in commands))


def _check_words(options: NewDatasetOptions) -> None:
    """Raise InputError if an option has an impossible value, before any table is read."""
    for option, given, words in (
        *(("--test", word, TESTS) for word in (options.test or "").split(",") if word),
        ("--tool", options.tool, TOOLS),
        ("--base", options.base, BASES),
        ("--control", options.control, CONTROLS),
    ):
        if given is not None:
            _word(given, words, option, "", "")
    if options.test is None and not asking.somebody_is_there():
        _word(None, TESTS, "--test", "", "")
    _friction(options.friction)
    if options.rate is not None and not 0.0 < options.rate < float("inf"):
        raise InputError(f"--rate {options.rate:g} is not possible; give a number above 0.")


def _refuse(options: NewDatasetOptions, names: Sequence[str], why: str) -> None:
    """Raise InputError if an option is given that the test does not have."""
    for name in names:
        if getattr(options, name) not in (None, ()):
            raise InputError(f"`{name}` {why}; omit it.")


def _show(export: Export) -> None:
    """Print the first lines and rows of a file."""
    for line in export.head[:8]:
        console.print(f"  {line}", style="dim", markup=False, highlight=False, overflow="ellipsis", no_wrap=True)
    table = Table(title=escape(str(export.path.name)), title_justify="left")
    for column in export.columns:
        table.add_column(escape(column.name + (f" [{column.unit}]" if column.unit else "")), justify="right")
    for row in range(min(ROWS_SHOWN, len(export.columns[0].values))):
        table.add_row(*(f"{column.values[row]:.6g}" for column in export.columns))
    console.print(table)


def _only_stress(export: Export, kind: str) -> bool:
    """Whether a file of a compression or tension test has a stress column and no force column."""
    from explicitfe.inverse.measured.columns import candidates

    return kind != "indentation" and not candidates(export, "force") and bool(candidates(export, "stress"))


def _choice(export: Export, quantity: Quantity, stated: str | None, lacking: list[str]) -> Choice | None:
    """Column and unit of a quantity: as given, by its name, or by asking."""
    from explicitfe.inverse.measured.columns import Choice, candidates, chosen
    from explicitfe.inverse.measured.new_dataset import missing
    from explicitfe.inverse.measured.quantities import QUANTITIES, unit_of

    column, unit = None, None
    if stated is not None:
        column, unit = chosen(export, quantity, stated)
    else:
        possible = candidates(export, quantity)
        column = possible[0] if len(possible) == 1 else None
        unit = None if column is None else unit_of(quantity, column.unit)
    units = list(QUANTITIES[quantity].units)
    if (column is None or unit is None) and not asking.somebody_is_there():
        lacking.append(missing(export, quantity, column))
        return None
    if column is None:
        names = ", ".join(f"{k + 1} {column.name}" for k, column in enumerate(export.columns))
        column = asking.ask(f"Column of the {quantity} ({names})", export.column)
        unit = unit_of(quantity, column.unit)

    def read_unit(word: str) -> str:
        known = unit_of(quantity, word)
        if known is None:
            raise InputError(f"please answer: {', '.join(units)}.")
        return known

    if unit is None:
        unit = asking.ask(f'Unit of "{column.name}" ({", ".join(units)})', read_unit, units[0])
    return Choice(column, quantity, unit)


def _beginning(path: Path) -> Export:
    """The first lines of a file, or all where these are no table: large files are read when all options are known."""
    from explicitfe.inverse.measured.export import read_export

    with suppress(InputError):
        return read_export(path, whole=False)
    return read_export(path)


def _whole(beginning: Export, choices: Sequence[Choice]) -> tuple[Export, list[Choice]]:
    """A whole file, and its columns that were chosen from the beginning of it."""
    from explicitfe.inverse.measured.export import read_export

    export = read_export(beginning.path)
    names = [[column.name for column in one.columns] for one in (beginning, export)]
    columns = [
        export.columns[beginning.columns.index(choice.column)] if names[0] == names[1] else export.column(choice.column.name)
        for choice in choices
    ]
    return export, [replace(choice, column=column) for choice, column in zip(choices, columns, strict=True)]


def _word(given: str | None, words: Sequence[str], option: str, question: str, usual: str) -> str:
    """One of a few words: as given, or by asking."""
    if given is None:
        if not asking.somebody_is_there():
            raise InputError(f"{option} is missing; give one of {', '.join(words)}.")
        return asking.ask(f"{question} ({', '.join(words)})", asking.one_of(words), usual)
    if given not in words:
        raise InputError(f'{option} "{given}" is not possible; {nearest(given, words)}')
    return given


def _length(given: float | None, option: str, question: str, lacking: list[str]) -> float:
    if given is None:
        if not asking.somebody_is_there():
            lacking.append(f"{option} NUMBER ({question[0].lower()}{question[1:]})")
            return 1.0
        return asking.ask(question, asking.a_number)
    return given


def _specimen(options: NewDatasetOptions, lacking: list[str]) -> RawTable:
    """The table [specimen]."""
    diameter_mm, height_mm, size_mm = options.diameter_mm, options.height_mm, options.size_mm
    if size_mm is not None and (diameter_mm is not None or height_mm is not None):
        raise InputError("--size-mm (a block) excludes --diameter-mm and --height-mm (a cylinder); give one of the two shapes.")
    shape = "block" if size_mm is not None else "cylinder"
    if size_mm is None and diameter_mm is None and asking.somebody_is_there():
        shape = asking.ask("Shape of the specimen (cylinder, block)", asking.one_of(("cylinder", "block")), "cylinder")
    if shape == "cylinder":
        diameter_mm = _length(diameter_mm, "--diameter-mm", "Diameter of the specimen in mm (for a block: --size-mm)", lacking)
        height_mm = _length(height_mm, "--height-mm", "Height of the specimen in mm", lacking)
        return {"shape": "cylinder", "radius_mm": 0.5 * diameter_mm, "height_mm": height_mm, "base": options.base}
    return {"shape": "block", "size_mm": _three(size_mm), "base": options.base}


def _three(given: str | None) -> list[float]:
    """Three lengths."""

    def read(line: str) -> list[float]:
        numbers = [asking.a_number(word) for word in line.replace(",", " ").replace("x", " ").split()]
        if len(numbers) != 3:
            raise InputError("give three numbers in mm, such as 20,20,10.")
        return numbers

    return (
        asking.ask("Dimensions of the block in mm, the last one along the load (20,20,10)", read)
        if given is None
        else read(given)
    )


def _tool_shape(kind: str, shape: str | None, lacking: list[str]) -> str:
    """Shape of the tool; clamps are for tension only, and planar tension has no other."""
    if shape is None and kind in ("compression", "planar"):
        return USUAL_TOOLS[kind]
    if shape is None and not asking.somebody_is_there():
        lacking.append(f"--tool {'|'.join(TOOLS if kind == 'tension' else TOOLS[:-1])}, here for {USUAL_TOOLS[kind]}")
        return USUAL_TOOLS[kind]
    shape = _word(shape, TOOLS, "--tool", "Tool", USUAL_TOOLS[kind])
    if (shape == "clamps" and kind not in ("tension", "planar")) or (kind == "planar" and shape != "clamps"):
        raise InputError(f"--tool {shape} is not for --test {kind}, and clamps are for tension only; give {USUAL_TOOLS[kind]}.")
    return shape


def _strip(length_mm: float | None, area_mm2: float | None, lacking: list[str]) -> Strip:
    """Dimensions of a strip between clamps."""
    from explicitfe.inverse.measured.new_dataset import Strip

    return Strip(
        _length(length_mm, "--length-mm", "Free length of the strip between the clamps in mm", lacking),
        _length(area_mm2, "--area-mm2", "Cross-section of the strip in mm2", lacking),
    )


def _rate(given: float | None, export: Export, time: str | None) -> float | None:
    """Loading rate, if there is no time column."""
    from explicitfe.inverse.measured.columns import candidates

    if given is not None or time is not None or candidates(export, "time") or not asking.somebody_is_there():
        return given
    if asking.ask("Is there a time column (yes, no)", asking.yes_or_no, "yes"):
        return None
    return asking.ask("Loading rate in mm/s or N/s", asking.a_number)


def _tool(shape: str, options: NewDatasetOptions, lacking: list[str]) -> RawTable:
    """The table [tool]."""
    table: RawTable = {"shape": shape}
    if shape != "platen":
        table["radius_mm"] = 0.5 * _length(options.tool_diameter_mm, "--tool-diameter-mm", "Diameter of the tool in mm", lacking)
    return table | {"control": options.control, "friction": _friction(options.friction)}


def _friction(given: str) -> float | str:
    try:
        return float(given)
    except ValueError:
        return _word(given, ("unknown", "stick"), "--friction", "", "")


def _one_specimen(given: bool | None, files: int) -> bool:
    if given is None and files > 1 and asking.somebody_is_there():
        return asking.ask("Are all files of the same specimen (yes, no)", asking.yes_or_no, "yes")
    return bool(given)
