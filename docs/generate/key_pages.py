"""The pages of keys: of scenarios, datasets and results, made from the types that the program reads and writes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from key_tables import KeyTables

SCENARIO_HEAD = """# Every key of a scenario

Made from the types that check a scenario. What the keys do, with examples: [The scenario file](scenarios.md). A key that
has no default and is not required may be left out.

"""
DATASET_HEAD = """# Every key of a dataset

Made from the types that check `dataset.toml`. The tables `[specimen]`, `[tool]` and `[noise]` may stand once for all curves; a
curve replaces single keys of them with a table of its own, such as `[curve.specimen]`.

"""
OTHERS_HEAD = """# Every key of other files

Made from the types that check them. How they are used: [design-test](close-loop.md#planning-a-test) reads protocols,
[a mesh of your own](own-mesh.md) has a model file, [predict](effects.md#predicting-measured-curves) and `--tissue` read tissue
files.

"""
OTHERS = {"protocol": "A planned test", "model": "The model file of a mesh", "tissue": "A tissue"}
RESULT_HEAD = """# Every key of a result

Made from the types that the program writes. What is in a result file and how to read it: [The result file](results.md).

## Fields and histories of a run in time

`<bone>` and `<point>` stand for each bone and each named point of the model.

"""


def scenario_page() -> str:
    """Keys of a run in time and of an indentation."""
    from explicitfe.scenario.indentation import IndentationScenario
    from explicitfe.scenario.transient import TransientScenario

    parts = [SCENARIO_HEAD]
    for kind, heading in ((TransientScenario, "A run in time"), (IndentationScenario, "An indentation")):
        parts += [f"## {heading}\n", KeyTables(kind.model_json_schema(), toml=True).markdown(level=3)]
    return "\n".join(parts)


def dataset_page() -> str:
    """Keys of ``dataset.toml``; the tables that a curve may replace in part are those of the merged curve."""
    from explicitfe.cli.file_schemas import file_schema

    return DATASET_HEAD + KeyTables(file_schema("dataset"), toml=True).markdown()


def other_files_page() -> str:
    """Keys of protocols, of model files of a mesh, and of tissue files."""
    from explicitfe.cli.file_schemas import file_schema

    parts = [OTHERS_HEAD]
    for kind, heading in OTHERS.items():
        parts += [f"## {heading}\n", KeyTables(file_schema(kind), toml=True).markdown(level=3)]
    return "\n".join(parts)


def result_page() -> str:
    """Fields, histories and what each command prints with ``--json``."""
    from explicitfe.cli.answers import ANSWERS, answer_schema
    from explicitfe.results.layout import DISPLACEMENT
    from explicitfe.run.indentation import INDENTATION_FIELDS, INDENTATION_HISTORY
    from explicitfe.run.quantities import cell_fields, history_columns, point_fields

    everything = ("velocity", "J", "hourglass_energy")
    parts = [
        RESULT_HEAD,
        _quantities({"displacement": DISPLACEMENT, **point_fields(everything, ["<bone>"])}, "field of nodes"),
        _quantities(cell_fields(everything), "field of elements"),
        _quantities(history_columns(["<point>"], ["<bone>"], ["<bone>"]), "history"),
        "## Fields and histories of an indentation\n",
        _quantities({"displacement": DISPLACEMENT}, "field of nodes"),
        _quantities(INDENTATION_FIELDS, "field of elements"),
        _quantities(INDENTATION_HISTORY, "history"),
    ]
    kinds: dict[tuple[Any, ...], list[str]] = {}
    for name, types in ANSWERS.items():
        kinds.setdefault(types, []).append(name)
    for name, *others in kinds.values():
        schema = answer_schema(name)
        parts.append(
            "## "
            + ", ".join(f"`{command.replace('blind-', 'blind ').replace('new-', 'new ')} --json`" for command in (name, *others))
            + "\n"
        )
        for choice in schema.get("anyOf", [schema]):
            if not choice.get("$ref", "").endswith("FailureAnswer"):
                parts.append(KeyTables({"$defs": schema["$defs"], **choice}, toml=False).markdown("The answer", level=3))
    return "\n".join(parts)


def _quantities(quantities: Mapping[str, Any], what: str) -> str:
    rows = [
        f"| `{name}` | {quantity.unit} | {quantity.components} | {quantity.description.replace('<', '&lt;')} |"
        for name, quantity in quantities.items()
    ]
    return "\n".join([f"| {what} | unit | numbers | meaning |", "|---|---|---|---|", *rows, ""])
