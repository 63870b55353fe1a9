"""JSON schemas of the files that a user writes, for editors that complete and check TOML."""

from __future__ import annotations

from typing import Any

from explicitfe.platform.errors import InputError, nearest

FILES = ("scenario", "dataset", "protocol", "model", "tissue")


def file_schema(kind: str) -> dict[str, object]:
    """The JSON schema of a kind of file.

    Raises
    ------
    InputError : there is no such kind.
    """
    if kind not in FILES:
        raise InputError(f'there is no schema of "{kind}"; {nearest(kind, FILES)}')
    if kind == "scenario":
        from explicitfe.simulate.scenario.read import json_schema

        return json_schema()
    if kind == "model":
        from explicitfe.fem.inputs.bounds import with_bounds
        from explicitfe.simulate.anatomy.own_mesh import MeshFile

        return {"$schema": "https://json-schema.org/draft/2020-12/schema", **with_bounds(MeshFile.model_json_schema())}
    from explicitfe.inverse.close_loop.design import ProtocolFile
    from explicitfe.inverse.measured.schema import schema_with_merged_tables
    from explicitfe.inverse.measured.tables import DatasetFile
    from explicitfe.inverse.predict.tissue import Tissue

    tables: Any = {"dataset": DatasetFile, "protocol": ProtocolFile, "tissue": Tissue}
    return schema_with_merged_tables(tables[kind])
