"""Definition of a sweep: the scenario, its runs and measures; and the folder that stores it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from explicitfe.platform.errors import InputError, MachineError, nearest, shortened
from explicitfe.platform.host.files import WITHOUT_ROOM, reason
from explicitfe.platform.host.text import text_of
from explicitfe.results.files.folder import whole_file
from explicitfe.results.files.provenance import version_of
from explicitfe.simulate.anatomy.tongue import assemble
from explicitfe.simulate.run.inputs import sums_of
from explicitfe.simulate.scenario.read import canonical, scenario_in
from explicitfe.simulate.scenario.transient import TransientScenario
from explicitfe.simulate.sweep.factors import Factor
from explicitfe.simulate.sweep.members import LARGEST_TABLE_OF_MEMBERS_BYTES, Design, Members, members_in
from explicitfe.simulate.sweep.own_measure import Measuring, OwnMeasure
from explicitfe.simulate.sweep.rows import PARTS, USUAL_PARTS

FORMAT = "explicitfe-sweep/1"
DEFINITION_FILE, MEMBERS_FILE = "sweep.json", "members.csv"
RESULTS_FOLDER, ROWS_FOLDER = "results", "rows"
ONE_THREAD = "analysis.threads=1"
# Number of runs that are checked before the first is computed: if all of them are invalid, a key is wrong.
READ_BEFORE_THE_FIRST = 20
MOST_WORDS_READ = 1000  # varied texts: each may name a file, and reading a scenario takes milliseconds
NAME_HEX_DIGITS = 16
PROGRAM_VERSION = version_of("explicitfe")


@dataclass(frozen=True)
class Definition:
    """A sweep.

    Attributes
    ----------
    path, text : the scenario file and its content.
    settings : ``key=value`` pairs of all runs.
    members : the values that each run sets in addition.
    parts : names of the measures in its table.
    own : the custom measures among them.
    design, factors, seed : origin of the runs.
    file_sums : SHA-256 of the files that the scenario names, and of those of the user's measures.
    added_muscles : muscles that runs set although the scenario does not list them; they pull as the first listed one does.
    """

    path: Path
    text: str
    settings: tuple[str, ...]
    members: Members
    parts: tuple[str, ...]
    own: dict[str, OwnMeasure]
    design: Design
    factors: tuple[Factor, ...]
    seed: int
    file_sums: dict[str, str]
    added_muscles: tuple[str, ...] = ()

    def settings_of(self, number: int) -> tuple[str, ...]:
        """All settings of a run; it uses one thread, unless the number of threads varies."""
        return (ONE_THREAD, *self.settings, *self.members.settings(number))

    def name_of(self, number: int) -> str:
        """A hash of the inputs of a run: the scenario, its files, its settings, and the version."""
        content = json.dumps([PROGRAM_VERSION, self.text, self.file_sums, self.settings_of(number)], sort_keys=True)
        return hashlib.sha256(content.encode()).hexdigest()[:NAME_HEX_DIGITS]

    def document(self) -> dict[str, Any]:
        """Content of the file ``sweep.json``, which defines the meaning of the rows."""
        return {
            "format": FORMAT,
            "version": PROGRAM_VERSION,
            "scenario": str(self.path),
            "scenario_text": self.text,
            "file_sums": self.file_sums,
            "settings": list(self.settings),
            "design": self.design,
            "seed": self.seed,
            "factors": [
                {"key": f.key, "low": f.low, "high": f.high} if f.is_range else {"key": f.key, "values": list(f.levels)}
                for f in self.factors
            ],
            "keys": list(self.members.keys),
            "members": len(self.members),
            "members_sha256": hashlib.sha256(self.members.table().encode()).hexdigest(),
            "measures": list(self.parts),
        }


def define(
    path: Path,
    settings: tuple[str, ...],
    members: Members,
    *,
    design: Design,
    factors: tuple[Factor, ...] = (),
    seed: int = 0,
    measures: Sequence[str | Measuring],
    origin: str = "`vary`",
) -> Definition:
    """Read the scenario and check its first runs.

    Parameters
    ----------
    measures : names of ``explicitfe.simulate.sweep.rows.PARTS``, and functions of the user.
    origin : origin of the runs for messages: an option, or the file of a table.

    Raises
    ------
    InputError : the scenario or all of the first runs are invalid, or a measure does not exist.
    """
    parts, own = _measures(measures)
    text = text_of(path, "a scenario is a TOML file; 'explicitfe list scenarios' names those at hand")
    refusals = []
    added: tuple[str, ...] = ()
    sums: dict[str, str] = {}
    for number in range(min(len(members), READ_BEFORE_THE_FIRST)):
        try:
            scenario, _ = scenario_in(text, path, (*settings, *members.settings(number)))
            if isinstance(scenario, TransientScenario):
                assemble(scenario, path.parent)  # refuses unknown muscles and materials
                added = tuple(muscle.name for muscle in scenario.muscle if muscle.name not in _listed_muscles(text, path))
        except InputError as error:
            refusals.append(error)
            continue
        if not isinstance(scenario, TransientScenario) and tuple(measures) != USUAL_PARTS:
            for part in parts:
                if part not in own:
                    raise InputError(
                        f"`measures` {part}: not available for indentations, whose rows contain the curve. Remove this option."
                    )
        sums = sums_of(path, scenario) | _sums_of_words(text, path, settings, members)
        break
    else:
        raise _refusal_of(refusals[0], text, path, settings, origin)
    sums |= {part: measure.sha256 for part, measure in own.items()}
    return Definition(path, text, settings, members, parts, own, design, factors, seed, sums, added)


def _listed_muscles(text: str, path: Path) -> set[str]:
    """Names of the muscles in the file; none where it is no scenario without the settings."""
    with suppress(InputError):
        scenario, _ = scenario_in(text, path)
        if isinstance(scenario, TransientScenario):
            return {muscle.name for muscle in scenario.muscle}
    return set()


def _sums_of_words(text: str, path: Path, settings: tuple[str, ...], members: Members) -> dict[str, str]:
    """Checksums of the files that runs name; of each varied text the first run with it is read."""
    sums: dict[str, str] = {}
    seen: set[tuple[str, str]] = set()
    for number, values in enumerate(members.values):
        words = {(key, value) for key, value in zip(members.keys, values, strict=True) if isinstance(value, str)} - seen
        if not words:
            continue
        seen |= words
        with suppress(InputError):  # such a run is refused when it is computed
            sums |= sums_of(path, scenario_in(text, path, (*settings, *members.settings(number)))[0])
        if len(seen) >= MOST_WORDS_READ:
            break
    return sums


def _refusal_of(refusal: InputError, text: str, path: Path, settings: tuple[str, ...], origin: str) -> InputError:
    """The error of the first run, which the scenario or the settings of the run have caused."""
    try:
        scenario_in(text, path, settings)
    except InputError as error:
        if str(error) == str(refusal):
            return refusal
    return InputError(f"{origin}: {str(refusal).removeprefix('`settings` ').removeprefix(f'{path}: ')}")


def _measures(wanted: Sequence[str | Measuring]) -> tuple[tuple[str, ...], dict[str, OwnMeasure]]:
    """The names of the measures, without repetitions, and the custom ones among them."""
    own: dict[str, OwnMeasure] = {}
    parts: list[str] = []
    for part in wanted:
        if isinstance(part, str):
            if part not in PARTS:
                raise InputError(f"`measures` {shortened(part)}: unknown measure; {nearest(part, PARTS)}")
            parts.append(part)
            continue
        measure = OwnMeasure(part)
        if measure.name in PARTS or any(measure.name == other.name and part != other.function for other in own.values()):
            raise InputError(f"measures: the name {measure.name} is used by another measure. Rename the function.")
        own[measure.full_name] = measure
        parts.append(measure.full_name)
    return tuple(dict.fromkeys(parts)), own


def begin(out: Path, wanted: Definition) -> None:
    """Create the folder of a sweep, or check that it contains the same sweep.

    Raises
    ------
    InputError : it contains other files or another sweep, or cannot be written.
    """
    document = wanted.document()
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: this is a file. Name a new or empty folder with `out`.")
    try:
        others = [path.name for path in out.iterdir() if not path.name.startswith(".")] if out.is_dir() else []
        if DEFINITION_FILE not in others and any(name not in _NAMES for name in others):
            raise InputError(f"{out}: this folder contains other files. Name a new or empty folder with `out`.")
        out.mkdir(parents=True, exist_ok=True)
        for folder in (RESULTS_FOLDER, ROWS_FOLDER):
            (out / folder).mkdir(exist_ok=True)
        # The definition is written last, so that a folder with it is complete. Several commands may begin the same sweep.
        if not (out / DEFINITION_FILE).exists():
            whole_file(out / MEMBERS_FILE, wanted.members.table())
            whole_file(out / DEFINITION_FILE, json.dumps(document, indent=1) + "\n", overwrite=False)
    except FileExistsError:
        pass
    except OSError as error:
        wrong = MachineError if error.errno in WITHOUT_ROOM else InputError
        raise wrong(f"{out}: cannot be written ({reason(error)}). Check the permissions and the free disk space.") from None
    begun = definition_of(out)
    for key, value in document.items():
        # KEY=word of a command is KEY="word" of Python.
        if begun.get(key) != value and (key != "settings" or [*map(canonical, begun[key])] != [*map(canonical, value)]):
            raise InputError(
                f"{out}: this folder contains another sweep ({_difference(key, begun.get(key), value)}). Name another folder "
                "with `out`, or rerun the original command to resume that sweep."
            )


def definition_of(out: Path) -> dict[str, Any]:
    """Read ``sweep.json``.

    Raises
    ------
    InputError : the folder contains no sweep, or a damaged one.
    """
    path = out / DEFINITION_FILE
    try:
        table = json.loads(text_of(path, "give the folder of a sweep", largest_bytes=LARGEST_TABLE_OF_MEMBERS_BYTES))
    except ValueError:
        raise InputError(f"{path}: this file is damaged. Rerun the sweep with a new folder (`out`).") from None
    if not isinstance(table, dict) or table.get("format") != FORMAT:
        raise InputError(
            f"{path}: this is no sweep of this version, whose format is {FORMAT}. Rerun the sweep with a new folder (`out`)."
        )
    return table


def members_of(out: Path) -> Members:
    """The runs of the sweep in a folder.

    Raises
    ------
    InputError : their table has changed since the sweep began.
    """
    path = out / MEMBERS_FILE
    text = text_of(path, "give the folder of a sweep", largest_bytes=LARGEST_TABLE_OF_MEMBERS_BYTES)
    if hashlib.sha256(text.encode()).hexdigest() != definition_of(out).get("members_sha256"):
        raise InputError(
            f"{path}: this table has changed since the sweep began. Restore it, or rerun the sweep with a new folder (`out`)."
        )
    return members_in(text, path)


_NAMES = {
    DEFINITION_FILE, MEMBERS_FILE, RESULTS_FOLDER, ROWS_FOLDER,
    "table.csv", "table.parquet", "table.partial.csv", "sensitivity.json", "report.html", "pictures",
}  # fmt: skip


def _difference(key: str, begun: object, wanted: object) -> str:
    if key in ("scenario_text", "file_sums", "members_sha256"):
        return {"scenario_text": "another scenario", "file_sums": "other model files"}.get(key, "other runs")
    return f"{key} {shortened(json.dumps(begun))} instead of {shortened(json.dumps(wanted))}"
