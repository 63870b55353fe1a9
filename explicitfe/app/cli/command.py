"""Commands made of Python functions: the signature gives arguments and options, the numpydoc docstring gives their help.

Positional parameters are arguments; keyword-only ones and those in ``OPTION_OF_PARAMETER`` are options. A command may share
parameters with a function of ``explicitfe.app.api``: it takes them as ``**options``, so that each is described once.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer

from explicitfe.app.cli.completion import complete_dataset, complete_result, complete_scenario
from explicitfe.platform.host.result_files import find_result

# Parameter -> its option and metavar, or the metavar of an argument, where the name alone does not give them.
OPTION_OF_PARAMETER = {
    "add": "--add DATASET",
    "answer": "--answer COMMAND",
    "as_json": "--json",
    "axes": "--axes X,Y,Z",
    "constants_by": "--constants-by KEY",
    "curves": "--curve ID",
    "effects": "--effects NAME",
    "everything": "--all",
    "field": "--field NAME",
    "file_format": "--format FORMAT",
    "fit": "--fit KEY=VALUE",
    "head": "--head SENSOR",
    "holdout": "--holdout ID",
    "like": "--like NAME",
    "list_runs": "--list",
    "mapping": "--map POINT=SENSOR",
    "measures": "--measure NAME",
    "model": "--model FILE",
    "muscles": "--muscle NAME=FORCE",
    "name": "--name NAME",
    "offset_s": "--offset-s S|fit",
    "out": "--out DIR",
    "reference_s": "--reference-s START:END",
    "register": "--register METHOD",
    "scheduler": "--scheduler ADDRESS",
    "settings": "--set KEY=VALUE",
    "size": "--size WxH",
    "size_mm": "--size MM",
    "sizes": "--elements N",
    "table": "--table CSV",
    "time_s": "--at-ms T",
    "times": "--times MS",
    "tissue": "--tissue MODEL",
    "tissue_group": "--tissue-group NAME",
    "to": "--to FORMAT",
    "tolerance": "--tolerance SHARE",
    "vary": "--vary KEY=VALUES",
    "viewpoint": "--from VIEW",
    "without": "--without PART",
}
# Parameters that mean the same in all commands.
SHARED_HELP = {
    "as_json": "Print one JSON object on stdout and nothing else.",
    "dataset": "Folder of a dataset, or a name from `explicitfe list datasets`.",
    "result": "Result file (.vtkhdf), or its name in outputs/.",
    "scenario": "Scenario file (TOML), or a name from `explicitfe list scenarios`.",
    "settings": "Set a value of the scenario.",
    "tissue": "Tissue model file whose constants and effects replace those of the scenario.",
    "tissue_group": "Group of constants in the model file, if it has several.",
}
Complete = Callable[[str], list[str]]
COMPLETIONS: dict[str, Complete] = {
    "dataset": complete_dataset,
    "result": complete_result,
    "results": complete_result,
    "scenario": complete_scenario,
}
# Word of an annotation -> the type on the command line.
_KINDS: dict[str, type] = {"Path": Path, "Source": Path, "str": str, "int": int, "float": float, "bool": bool}
SECONDS_PER_MS = 1e-3


def command(
    *sources: Callable[..., object],
    without: Sequence[str] = (),
    completions: Mapping[str, Complete] | None = None,
    **spelled: str,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorate a function as a command.

    Parameters
    ----------
    sources : functions or dataclasses whose parameters the command has too, except ``progress``.
    without : parameters of ``sources`` that the command does not have.
    completions : shell completion of parameters, in addition to ``COMPLETIONS``.
    spelled : options of parameters, in addition to ``OPTION_OF_PARAMETER``.
    """

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        own = {name: one for name, one in inspect.signature(function).parameters.items() if one.kind is not one.VAR_KEYWORD}
        parameters: dict[str, inspect.Parameter] = {name: one for name, one in own.items() if one.kind is not one.KEYWORD_ONLY}
        texts: dict[str, str] = {}
        for source in sources:
            parameters |= {name: one for name, one in inspect.signature(source).parameters.items() if name not in parameters}
            texts |= _help_texts(source)[1]
        words, own_texts = _help_texts(function)
        texts |= SHARED_HELP | own_texts
        options, completes = OPTION_OF_PARAMETER | spelled, COMPLETIONS | dict(completions or {})
        shown = [
            _shown(one, texts.get(name, name), options.get(name, ""), completes.get(name))
            for name, one in (parameters | own).items()
            if name in own or not (name in ("progress", *without) or one.kind is one.VAR_KEYWORD)
        ]

        @wraps(function)
        def run_command(**given: Any) -> None:
            kept = {name: value for name, value in given.items() if value is not None and value != []}
            if "time_s" in kept:
                kept["time_s"] *= SECONDS_PER_MS
            function(**kept)

        run_command.__doc__ = words
        run_command.__signature__ = inspect.Signature(shown)  # type: ignore[attr-defined]
        run_command.__annotations__ = {one.name: one.annotation for one in shown}
        del run_command.__wrapped__
        return run_command

    return decorate


def _help_texts(function: Callable[..., object]) -> tuple[str, dict[str, str]]:
    """The text of a docstring before its sections, and the help of each parameter; none under ``python -OO``."""
    words, _, sections = (inspect.getdoc(function) or "").partition("\nParameters\n----------\n")
    entries = re.findall(r"^(\w[\w, ]*) : (.*(?:\n .*)*)", re.split(r"\n\w+\n---", sections)[0], re.M)
    return words, {name: _plain(text) for names, text in entries for name in names.split(", ")}


def _plain(text: str) -> str:
    """The text on a parameter as a sentence of the help."""
    joined = re.sub(r":func:`(\w+)`", r"\1", " ".join(text.split())).replace("``", "`")
    return joined[0].upper() + joined[1:]


def _shown(parameter: inspect.Parameter, text: str, spelling: str, complete: Complete | None) -> inspect.Parameter:
    """The parameter as typer asks for it."""
    words, default = str(parameter.annotation), parameter.default
    several = "Sequence[" in words or "list[" in words
    kind = next(kind for word, kind in _KINDS.items() if re.search(rf"\b{word}\b", words))
    if default is not parameter.empty:
        default = None if several or default is None else kind(default)
    if parameter.name == "time_s":
        text = re.sub(r", s\b", ", ms", text)
    text, _, usual = text.rstrip(".").partition("; by default ")
    common: Any = {"autocompletion": complete, "show_default": usual or default not in (None, parameter.empty)}
    flag, _, metavar = spelling.partition(" ") if spelling.startswith("--") else ("", "", spelling)
    if flag or parameter.kind is parameter.KEYWORD_ONLY:
        flag = flag or f"--{parameter.name.replace('_', '-')}"
        text = f"{text}. Can be repeated." if several else f"{text}."
        info = typer.Option(flag, help=text, metavar=metavar or ("FILE" if kind is Path else None), **common)
    else:
        find = _find if complete is complete_result else None
        info = typer.Argument(help=f"{text}.", metavar=metavar or None, callback=find, **common)
    annotation: Any = list[kind] if several else kind  # type: ignore[valid-type]
    annotation = annotation | None if default is None else annotation
    return parameter.replace(kind=parameter.KEYWORD_ONLY, default=default, annotation=Annotated[annotation, info])


def _find(given: Path | list[Path]) -> Path | list[Path]:
    """Replace names of results by their paths."""
    return find_result(given) if isinstance(given, Path) else [find_result(path) for path in given]
