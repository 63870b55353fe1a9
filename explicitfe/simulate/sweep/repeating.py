"""The stored definition of a sweep, and the commands that repeat it."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

from pydantic import BaseModel, JsonValue, ValidationError

from explicitfe.platform.errors import InputError
from explicitfe.platform.host.shipped import name_of
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.simulate.sweep.definition import DEFINITION_FILE, MEMBERS_FILE, ONE_THREAD, definition_of
from explicitfe.simulate.sweep.factors import Factor, factor_of
from explicitfe.simulate.sweep.members import Design, Members
from explicitfe.simulate.sweep.rows import PARTS, USUAL_PARTS

LONGEST_LINE_OF_A_COMMAND = 100


class BegunFactor(BaseModel):
    """A factor in ``sweep.json``: ``values``, or ``low`` and ``high`` of a range."""

    key: str
    low: float | None = None
    high: float | None = None
    values: list[JsonValue] | None = None

    @property
    def factor(self) -> Factor:
        """The factor itself."""
        if self.values is not None:
            return Factor(self.key, tuple(self.values))
        return Factor(self.key, low=self.low or 0.0, high=self.high or 0.0)


class BegunSweep(BaseModel):
    """The file ``sweep.json``; unknown keys are ignored."""

    version: str
    scenario: str
    scenario_text: str
    settings: list[str]
    design: Design
    seed: int
    factors: list[BegunFactor]
    keys: list[str]
    members: int
    measures: list[str]


def begun_sweep(folder: Path) -> BegunSweep:
    """Read the definition of the sweep in a folder.

    Raises
    ------
    InputError : the folder contains no sweep, or a damaged one.
    """
    try:
        return BegunSweep.model_validate(definition_of(folder))
    except ValidationError as error:
        where = ".".join(map(str, error.errors()[0]["loc"]))
        raise InputError(
            f"{folder / DEFINITION_FILE}: this file is damaged ({where}). Rerun the sweep with a new folder (--out)."
        ) from None


def design_in_words(begun: BegunSweep) -> str:
    """Such as "60 random samples of 5 keys (seed 0)"."""
    of_keys = f"{len(begun.keys)} key{'' if len(begun.keys) == 1 else 's'}"
    seed = f" (seed {begun.seed})"
    match begun.design:
        case "random":
            return f"{begun.members} random samples of {of_keys}{seed}"
        case "sobol":
            return f"{begun.members} runs of a Sobol design over {of_keys}{seed}"
        case "morris":
            return f"{begun.members} runs of a Morris design over {of_keys}{seed}"
        case "table":
            return f"{begun.members} runs of a table of {of_keys}"
    return f"{begun.members} runs, all combinations of the values of {of_keys}"


def commands_of(folder: Path, begun: BegunSweep, members: Members, shown: int | None) -> list[str]:
    """The commands that repeat the sweep, its page and one of its runs.

    Parameters
    ----------
    shown : the number of that run; None: none.
    """
    scenario, name = shlex.quote(name_of(begun.scenario)), shlex.quote(str(folder))
    own = [part for part in begun.measures if part not in PARTS]
    commands = [
        *(
            [f"# without the custom measures {', '.join(own)}, which only explicitfe.sweep(..., measures=) in Python accepts"]
            if own
            else []
        ),
        _command(
            f"explicitfe sweep {scenario}", [*_options(folder, begun), ("--out", f"{folder}-again" if own else str(folder))]
        ),
        f"explicitfe report {name} --overwrite",
    ]
    if shown is not None:
        settings = [ONE_THREAD, *begun.settings, *members.settings(shown)]
        commands += [f"# run {shown} alone", _command(f"explicitfe run {scenario}", [("--set", one) for one in settings])]
    return commands


def _command(begin: str, options: Sequence[tuple[str, str]]) -> str:
    lines = [begin]
    for name, value in options:
        option = f"{name} {shlex.quote(value)}"
        if len(lines[-1]) + len(option) < LONGEST_LINE_OF_A_COMMAND:
            lines[-1] += f" {option}"
        else:
            lines.append(f"  {option}")
    return " \\\n".join(lines)


def _options(folder: Path, begun: BegunSweep) -> Iterator[tuple[str, str]]:
    """The options of the command other than the folder."""
    for setting in begun.settings:
        yield "--set", setting
    if begun.design == "table":
        yield "--table", str(folder / MEMBERS_FILE)
    for entry in begun.factors:
        yield "--vary", vary_text(entry.factor)
    groups = {"random": 1, "sobol": len(begun.keys) + 2, "morris": len(begun.keys) + 1}
    if begun.design in groups:
        yield f"--{begun.design}", str(begun.members // groups[begun.design])
    if begun.seed:
        yield "--seed", str(begun.seed)
    if tuple(begun.measures) != USUAL_PARTS:
        for part in begun.measures:
            if part in PARTS:
                yield "--measure", part


def vary_text(factor: Factor) -> str:
    """A factor in the syntax of ``--vary``; equally spaced values become a range with their number."""
    if factor.is_range:
        return f"{factor.key}={_short(factor.low)}:{_short(factor.high)}"
    if _are_numbers(factor.levels):
        even = f"{factor.key}={_short(factor.levels[0])}:{_short(factor.levels[-1])}:{len(factor.levels)}"
        try:
            if factor_of(even).levels == factor.levels:
                return even
        except InputError:  # values that do not increase
            pass
    return f"{factor.key}={','.join(map(_value_text, factor.levels))}"


def _are_numbers(levels: Sequence[object]) -> bool:
    return len(levels) > 2 and all(isinstance(level, float) for level in levels)


def _short(value: object) -> str:
    return repr(value).removesuffix(".0")


def _value_text(level: object) -> str:
    """A value in the syntax of ``--vary``: a plain word needs no quotation marks."""
    if isinstance(level, str) and factor_of(f"key.name={level},0").levels == (level, 0):
        return level
    return toml_value(level)
