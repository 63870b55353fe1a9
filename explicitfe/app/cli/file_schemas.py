"""JSON schemas of the files that a user writes, for editors that complete and check TOML."""

from __future__ import annotations

from collections.abc import Callable

from explicitfe.platform.errors import InputError, nearest

_DRAFT = "https://json-schema.org/draft/2020-12/schema"


def _scenario() -> dict[str, object]:
    from explicitfe.simulate.scenario.read import json_schema

    return json_schema()


def _dataset() -> dict[str, object]:
    from explicitfe.inverse.measured.schema import dataset_schema

    return dataset_schema()


def _protocol() -> dict[str, object]:
    from explicitfe.inverse.close_loop.design import ProtocolFile
    from explicitfe.inverse.measured.schema import schema_with_merged_tables

    return schema_with_merged_tables(ProtocolFile)


def _model() -> dict[str, object]:
    from explicitfe.fem.inputs.bounds import with_bounds
    from explicitfe.simulate.anatomy.own_mesh import MeshFile

    return {"$schema": _DRAFT, **with_bounds(MeshFile.model_json_schema())}


def _tissue() -> dict[str, object]:
    from explicitfe.inverse.measured.schema import schema_with_merged_tables
    from explicitfe.inverse.predict.tissue import Tissue

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
