"""``explicitfe inspect``."""

from __future__ import annotations

from pathlib import Path

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.cli.completion import complete_result
from explicitfe.app.view.progress import following


@command(completions={"file": complete_result})
def inspect(file: Path, *, as_json: bool = False) -> None:
    """Show the contents of a result: status, times, fields, energies, probes, provenance. Or the named sets of a mesh file.

    Example: [bold]explicitfe inspect vowel-i[/bold]

    Example: [bold]explicitfe inspect bar.msh[/bold]

    Parameters
    ----------
    file : result file (.vtkhdf) or its name in outputs/, or a mesh file (.msh, .inp, .feb, .vtu, ...).
    """
    if _is_mesh(file):
        with following(console, f"reading {file}"):
            from explicitfe.app.tools.mesh_contents import mesh_contents
            from explicitfe.app.view.terminal.program import mesh_table

            contents = mesh_contents(file)
        print_answer(contents, as_json, lambda: mesh_table(contents))
        return
    with following(console, f"reading {file}"):
        from explicitfe.app.view.terminal.stored import result_table
        from explicitfe.results.files import open_result
        from explicitfe.results.measure.measure import measures_if_any

        with open_result(file) as opened:
            held, measures = opened.contents(), measures_if_any(opened)
    document = {**held, "measures": measures and measures.document}
    print_answer(document, as_json, lambda: result_table(held, measures), held["summary"].get("warnings", []))


def _is_mesh(file: Path) -> bool:
    """Whether a file is taken for a mesh: by its suffix, or because it has another one than a result and is not HDF5."""
    from explicitfe.results.files.stored import HDF5_SIGNATURE
    from explicitfe.simulate.meshes.mesh_file import MESH_SUFFIXES

    try:
        if file.suffix.lower() in ("", ".vtkhdf") or not file.is_file():
            return False
        with file.open("rb") as opened:
            return file.name.lower().endswith(MESH_SUFFIXES) or opened.read(len(HDF5_SIGNATURE)) != HDF5_SIGNATURE
    except OSError:
        return False
