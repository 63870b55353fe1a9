"""``explicitfe new model``."""

from __future__ import annotations

from pathlib import Path

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.cli.new import print_next
from explicitfe.app.view.progress import following


@command()
def new_model(*, mesh: Path, size_mm: float | None = None, unit: str = "mm", out: Path = Path(), as_json: bool = False) -> None:
    """Write a model file and a scenario for a mesh, with its sets; mesh a closed surface with hexahedra.

    Example: [bold]explicitfe new model --mesh blob.stl --size 4[/bold]

    Example: [bold]explicitfe new model --mesh tongue.msh --unit m[/bold]

    Parameters
    ----------
    mesh : mesh file (.msh, .inp, .feb, .vtu, ...) or closed surface (.stl, .obj, .ply).
    size_mm : edge of the hexahedra in a surface, in mm.
    unit : unit of the lengths in the file: m, cm or mm.
    out : output folder.
    """
    with following(console, f"meshing {mesh}" if size_mm else f"reading {mesh}"):
        from explicitfe.app.tools.new_model import write_new_model
        from explicitfe.app.view.terminal.program import new_model_table

        model = write_new_model(mesh, out, size_mm=size_mm, unit=unit)
    print_answer(model, as_json, lambda: new_model_table(**model))
    if not as_json:
        print_next(f"explicitfe check {model['scenario']}", f"explicitfe run {model['scenario']}")
