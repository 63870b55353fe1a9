"""What an identification leaves on disk: a whole folder or nothing."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from explicitfe.errors import RunError
from explicitfe.predict.setup import Setup
from explicitfe.results.folder import whole_folder
from explicitfe.solve.equilibrium import Equilibrium

SUMMARY_FILE = "identify.json"

STEPS = 8  # loads of the scenario and on the way to the deformed picture


FEW = 20  # force steps that a scenario repeats as they are


@dataclass(frozen=True)
class Deformed:
    """A test with fitted constants, to be run once more.

    Attributes
    ----------
    loads : (k,) N or m, as measured.
    """

    setup: Setup
    constants: np.ndarray
    by_force: bool
    loads: np.ndarray

    def steps(self) -> list[float]:
        """Loads to run, N or m, from above 0 up."""
        loads = self.loads[self.loads > 0.0]
        if self.by_force and len(loads) <= FEW and (np.diff(loads) > 0.0).all():
            return [float(x) for x in loads]
        return [float(x) for x in loads.max() * np.arange(1, STEPS + 1) / STEPS]


def write(target: Path, summary: dict[str, Any], pictures: dict[str, dict[str, Any]]) -> None:
    """Write all files or none; ``summary["files"]`` lists them afterwards.

    Raises
    ------
    InputError : the folder cannot be written.
    """
    with whole_folder(target) as folder:
        _fill(folder, target, summary, pictures)


def _fill(folder: Path, target: Path, summary: dict[str, Any], pictures: dict[str, dict[str, Any]]) -> None:
    from explicitfe.view import fit as fitfigures

    names: list[str] = []

    def file(stem: str, group: str, ending: str) -> Path:
        end = f"-{slug(group)}" if len(summary["groups"]) > 1 else ""
        names.append(f"{stem}{end}{ending}")
        return folder / names[-1]

    for name, shown in pictures.items():
        title = summary["dataset"] + (f", {name}" if len(summary["groups"]) > 1 else "")
        fitfigures.fit(file("fit", name, ".png"), title, shown["curves"], shown["constants"])
        if "profiles" in shown:
            fitfigures.profiles(file("profiles", name, ".png"), title, shown["profiles"])
        if "paper" in shown:
            fitfigures.convergence(file("convergence", name, ".png"), title, shown["paper"])
        if "deformed" in shown:
            picture = section(shown["deformed"])
            if picture is not None:
                fitfigures.deformed(file("deformed", name, ".png"), title, picture)
            file("fitted", name, ".toml").write_text(scenario(shown["deformed"], summary, name), encoding="utf-8")
    file_text = "".join(_material(name, group, summary) for name, group in summary["groups"].items() if "constants" in group)
    (folder / "material.toml").write_text(file_text, encoding="utf-8")
    names.append("material.toml")
    summary["files"] = [str(target / name) for name in [SUMMARY_FILE, *names]]
    text = json.dumps(plain(summary), indent=2, allow_nan=False)
    (folder / SUMMARY_FILE).write_text(text + "\n", encoding="utf-8")


def slug(name: str) -> str:
    """A name as part of a file's."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-.") or "group"


def plain(value: Any) -> Any:
    """JSON has no infinity: null instead."""
    if isinstance(value, dict):
        return {key: plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner) for inner in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value


def scenario(shown: Deformed, summary: dict[str, Any], name: str) -> str:
    """A scenario that repeats the test with the fitted constants; ``explicitfe run`` takes it."""
    constants = ", ".join(
        f"{key} = {json.dumps(value)}"
        for key, value in shown.setup.material(*(float(round(c, 4)) for c in shown.constants)).items()
    )
    loads = shown.steps()
    course = ("forces_N", loads) if shown.by_force else ("displacements_mm", [1e3 * x for x in loads])
    title = f"{summary['title']}: constants {name}, fitted"
    lines = [
        f"title = {json.dumps(title, ensure_ascii=False)}",
        f'question = "What does the tissue that was identified ({summary["method"]}) do in the test that identified it?"',
        "",
        "[model]",
        'name = "specimen"',
        *(f"{key} = {json.dumps(value)}" for key, value in shown.setup.specimen.items()),
        f"material = {{ {constants} }}",
        "",
        "[tool]",
        *(f"{key} = {json.dumps(value)}" for key, value in shown.setup.tool.items()),
        "",
        "[analysis]",
        'type = "relaxation"',
        f"{course[0]} = {json.dumps([float(f'{x:.6g}') for x in course[1]])}",
    ]
    return "\n".join(lines) + "\n"


def _material(name: str, group: dict[str, Any], summary: dict[str, Any]) -> str:
    """A table of constants as a scenario's [model] takes it in ``material = { … }``."""
    head = f"[{json.dumps(name)}]\n"
    values = "".join(f"{key} = {entry['value']:.6g}\n" for key, entry in group["constants"].items())
    return f'{head}law = "yeoh"\n{values}poisson = {summary["poisson"]:g}\n\n'


def section(shown: Deformed) -> dict[str, Any] | None:
    """Elements in the plane y = 0 at the largest load, their energy densities, and the tool: see ``fitfigures.deformed``.

    None where the load is not reached: the fit stands without its picture.
    """
    try:
        body = shown.setup.relaxation(*map(float, shown.constants))
    except RunError:
        return None
    reached = None
    for load in shown.steps():
        reached = body.press(load) if shown.by_force else body.move(load)
        if not isinstance(reached, Equilibrium):
            return None
    assert isinstance(reached, Equilibrium)
    height = body.model.tool.height_m - body.touch_m if body.model.tool is not None else 0.0
    return {
        "mesh": body.model.mesh,
        "displacement_m": body.displacement,
        "energy_Pa": body.element_fields()["strain_energy_density"],
        "tool": shown.setup.tool,
        "lowest_mm": 1e3 * (height - reached.displacement_m),
        "load": f"{reached.force_N:.3g} N, {1e3 * reached.displacement_m:.3g} mm",
    }
