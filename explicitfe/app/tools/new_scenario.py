"""A scenario of one's own to begin with: muscles of the tongue and their forces, or a copy of one that comes with the program."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path

from typing_extensions import TypedDict

from explicitfe.platform.errors import InputError, nearest, shortened
from explicitfe.platform.host import shipped
from explicitfe.platform.host.files import create_private, reason, rename_new
from explicitfe.platform.host.text import text_of
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.run.prepare import prepare

GESTURE = """\
# Every key: explicitfe schema, and the page on the scenario file. Look at it before it runs: explicitfe check {name}.toml
title = {title}

[model]
name = "tongue"
resolution = "medium"                   # or "coarse", "fine"
material = "buchaillard-2009"           # explicitfe list materials
damping = {{ alpha_per_s = 40.0, beta_s = 0.03 }}
attachment = "area"                     # held by jaw and hyoid bone

[[bone]]                                # what the tongue can touch
name = "palate"

[[bone]]
name = "jaw"

{muscles}[analysis]
type = "transient"
duration_ms = {duration_ms}

[record]
every_ms = 2.0
"""
MUSCLE = """\
[[muscle]]
name = "{name}"{of}
force_N = {force_N}
profile = "ramp"
rise_ms = 50.0
distribution = "stress"

"""
NAME_COLUMN = 40  # where comments begin
# What a shipped scenario says of itself, which a changed copy no longer does.
_OWN_WORDS = re.compile(r'^(title|question|expect) = ("""(.|\n)*?"""|.*)\n|^\[\[expected\]\]\n(.+\n)*', re.M)
_SCHEMA_LINE = re.compile(r"^#:schema .*\n")


class NewScenario(TypedDict):
    """A scenario that was written: its file, its title, and the forces of its muscles [N]; empty for a copy."""

    scenario: str
    title: str
    like: str | None
    muscles: dict[str, float]


def muscles_of_the_tongue() -> dict[str, str]:
    """Name of each muscle of the built-in tongue -> what it does."""
    muscles = catalogue.built_in("tongue").muscles
    return {name: f"{muscle.title}: {muscle.action}" for name, muscle in muscles.items()}


def parsed_forces(words: str) -> dict[str, float]:
    """Forces [N] of muscles, from "GGp=2 GGa=0.2".

    Raises
    ------
    InputError : it is none, or there is no such muscle.
    """
    muscles = muscles_of_the_tongue()
    forces: dict[str, float] = {}
    for word in words.replace(",", " ").split():
        name, _, number = word.partition("=")
        if name not in muscles:
            raise InputError(f'there is no muscle "{shortened(name)}"; {nearest(name, muscles)}')
        try:
            forces[name] = float(number)
        except ValueError:
            raise InputError(f'"{shortened(word)}": write NAME=FORCE with the force in N, such as {name}=1.5.') from None
    if not forces:
        raise InputError("name a muscle with its force in N, such as GGp=2.")
    return forces


def write_new_scenario(
    path: Path,
    *,
    title: str | None = None,
    forces_N: Mapping[str, float] | None = None,
    duration_ms: float = 200.0,
    like: str | None = None,
) -> NewScenario:
    """Write a scenario that can be run at once.

    Parameters
    ----------
    path : the file, which must not exist; ".toml" is added where it has no ending.
    title : heads tables and pictures; the name of the file if left out.
    forces_N : muscle -> force summed over its fibres, which rises within 50 ms.
    like : name of a scenario that is copied, instead of forces.

    Raises
    ------
    InputError : the file exists, cannot be written, or would be no scenario. Nothing is written.
    """
    path = path if path.suffix else path.with_name(f"{path.name}.toml")
    if path.suffix != ".toml":
        raise InputError(f'{path}: a scenario is a TOML file; let its name end in ".toml".')
    if os.path.lexists(path):
        raise InputError(f"{path}: this exists already; name another file.")
    title = title or path.stem
    text = _copied(like, title) if like is not None else _gesture(path.stem, title, forces_N or {}, duration_ms)
    _write(path, text)
    return {"scenario": str(path), "title": title, "like": like, "muscles": dict(forces_N or {})}


def _gesture(name: str, title: str, forces_N: Mapping[str, float], duration_ms: float) -> str:
    muscles = muscles_of_the_tongue()
    tables = []
    for muscle, force_N in forces_N.items():
        line = f'name = "{muscle}"'
        of = f"{' ' * max(NAME_COLUMN - len(line), 2)}# {muscles[muscle]}"
        tables.append(MUSCLE.format(name=muscle, of=of, force_N=force_N))
    return GESTURE.format(name=name, title=toml_value(title), muscles="".join(tables), duration_ms=float(duration_ms))


def _copied(like: str, title: str) -> str:
    """The text of a shipped scenario under another title, without what it says of its own result."""
    names = shipped.scenarios()
    if like not in names:
        raise InputError(f"--like {shortened(like)}: no scenario of that name comes with the program; {nearest(like, names)}")
    text = text_of(names[like], "install the program again")
    bare = _SCHEMA_LINE.sub("", _OWN_WORDS.sub("", text)).lstrip("\n")
    return f"# A copy of {like}, which comes with the program.\ntitle = {toml_value(title)}\n\n{bare}"


def _write(path: Path, text: str) -> None:
    """Write the file if it is a scenario that can be built, and if nothing has its name by now."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        number, beside = create_private(path.parent, path.name)
    except OSError as error:
        raise InputError(f"{path}: this cannot be written ({reason(error)}).") from None
    try:
        with os.fdopen(number, "w", encoding="utf-8") as file:
            file.write(text)
        try:
            prepare(beside)
        except InputError as error:
            raise InputError(str(error).replace(str(beside), str(path))) from None
        rename_new(beside, path)
    except FileExistsError:
        raise InputError(f"{path}: this exists already; name another file.") from None
    except OSError as error:
        raise InputError(f"{path}: this cannot be written ({reason(error)}).") from None
    finally:
        beside.unlink(missing_ok=True)
