"""JSON schemas of the files that a user writes, for editors that complete and check TOML."""

from __future__ import annotations

from collections.abc import Callable

from explicitfe.errors import InputError, nearest

_DRAFT = "https://json-schema.org/draft/2020-12/schema"


def _scenario() -> dict[str, object]:
    from explicitfe.scenario.read import json_schema

    return json_schema()


def _dataset() -> dict[str, object]:
    from explicitfe.measured.schema import dataset_schema

    return dataset_schema()


def _protocol() -> dict[str, object]:
    from explicitfe.close_loop.design import ProtocolFile
    from explicitfe.measured.schema import schema_with_merged_tables

    return schema_with_merged_tables(ProtocolFile)


def _model() -> dict[str, object]:
    from explicitfe.model.own_mesh import MeshFile
    from explicitfe.scenario.bounds import with_bounds

    return {"$schema": _DRAFT, **with_bounds(MeshFile.model_json_schema())}


def _tissue() -> dict[str, object]:
    from explicitfe.measured.schema import schema_with_merged_tables
    from explicitfe.predict.tissue import Tissue

    return schema_with_merged_tables(Tissue)


# Kind of file -> what makes its schema.
FILES: dict[str, Callable[[], dict[str, object]]] = {
    "scenario": _scenario,
    "dataset": _dataset,
    "protocol": _protocol,
    "model": _model,
    "tissue": _tissue,
}


def file_schema(kind: str) -> dict[str, object]:
    """The JSON schema of a kind of file.

    Raises
    ------
    InputError : there is no such kind.
    """
    if kind not in FILES:
        raise InputError(f'there is no schema of "{kind}"; {nearest(kind, FILES)}')
    return FILES[kind]()
