"""Pages of all keys of scenarios, datasets and results, generated from the types of the program."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, cast, get_args

from key_tables import KeyTables

SCENARIO_HEAD = """# Scenario keys

Generated from the types that validate a scenario. [The scenario file](scenarios.md) explains the keys with examples. A key
without a default that is not required can be omitted.

"""
DATASET_HEAD = """# Dataset keys

Generated from the types that validate `dataset.toml`. The tables `[specimen]`, `[tool]` and `[noise]` apply to all curves. A
curve can override single keys with its own table, such as `[curve.specimen]`.

"""
OTHERS_HEAD = """# Keys of other files

Generated from the types that validate them. [design-test](close-loop.md#planning-a-test) reads protocols,
[your own mesh](own-mesh.md) is described by a model file, and [predict](effects.md#predicting-measured-curves) and `--tissue`
read tissue files.

"""
OTHERS = {"protocol": "Protocol of a planned test", "model": "Model file of a mesh", "tissue": "Tissue file"}
RESULT_HEAD = """# Result keys

Generated from the types that the program writes. [The result file](results.md) explains how to read a result.

## Fields and histories of a dynamic run

`<bone>` and `<point>` are placeholders for each bone and each named point of the model.

"""


def scenario_page() -> str:
    """Keys of a dynamic run and of an indentation."""
    from explicitfe.simulate.scenario.indentation import IndentationScenario
    from explicitfe.simulate.scenario.transient import TransientScenario

    parts = [SCENARIO_HEAD]
    for kind, heading in ((TransientScenario, "Dynamic run"), (IndentationScenario, "Indentation")):
        parts += [f"## {heading}\n", KeyTables(kind.model_json_schema(), toml=True).markdown(level=3)]
    return "\n".join(parts)


def dataset_page() -> str:
    """Keys of ``dataset.toml``, including the tables that a curve can override."""
    from explicitfe.app.cli.file_schemas import file_schema

    return DATASET_HEAD + KeyTables(file_schema("dataset"), toml=True).markdown()


def other_files_page() -> str:
    """Keys of protocols, of model files of a mesh, and of tissue files."""
    from explicitfe.app.cli.file_schemas import file_schema

    parts = [OTHERS_HEAD]
    for kind, heading in OTHERS.items():
        parts += [f"## {heading}\n", KeyTables(file_schema(kind), toml=True).markdown(level=3)]
    return "\n".join(parts)


def result_page() -> str:
    """Fields, histories and the ``--json`` answers of all commands."""
    from explicitfe.app.cli.answers import ANSWERS_OF_COMMANDS, answer_schema
    from explicitfe.fem.inputs.limits import StressField
    from explicitfe.results.files.layout import DISPLACEMENT
    from explicitfe.simulate.run.indentation import INDENTATION_FIELDS, INDENTATION_HISTORY
    from explicitfe.simulate.run.quantities import cell_fields, history_columns, point_fields

    everything = ("velocity", "J", "hourglass_energy", *get_args(StressField))
    model: Any = SimpleNamespace(bones=[SimpleNamespace(name="<bone>", motion=True)], probes=["<point>"], surfaces=None)
    parts = [
        RESULT_HEAD,
        _quantities({"displacement": DISPLACEMENT, **point_fields(everything, model)}, "nodal field"),
        _quantities(cell_fields(everything), "element field"),
        _quantities(history_columns(model, [], [cast(Any, SimpleNamespace(name="<set>"))]), "history"),
        "## Fields and histories of an indentation\n",
        _quantities({"displacement": DISPLACEMENT}, "nodal field"),
        _quantities(INDENTATION_FIELDS, "element field"),
        _quantities(INDENTATION_HISTORY, "history"),
    ]
    kinds: dict[tuple[Any, ...], list[str]] = {}
    for name, types in ANSWERS_OF_COMMANDS.items():
        kinds.setdefault(types, []).append(name)
    for name, *others in kinds.values():
        schema = answer_schema(name)
        parts.append("## " + ", ".join(f"`{command.replace('new-', 'new ')} --json`" for command in (name, *others)) + "\n")
        for choice in schema.get("anyOf", [schema]):
            if not choice.get("$ref", "").endswith("FailureAnswer"):
                parts.append(KeyTables({"$defs": schema["$defs"], **choice}, toml=False).markdown("The answer", level=3))
    return "\n".join(parts)


def _quantities(quantities: Mapping[str, Any], what: str) -> str:
    rows = [
        f"| `{name}` | {quantity.unit} | {quantity.components} | {quantity.description.replace('<', '&lt;')} |"
        for name, quantity in quantities.items()
    ]
    return "\n".join([f"| {what} | unit | components | meaning |", "|---|---|---|---|", *rows, ""])
