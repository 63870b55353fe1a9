"""Files of an identification: a complete folder or nothing."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from explicitfe.app.view.json_text import json_text
from explicitfe.app.view.page.identify import identify_page
from explicitfe.inverse.identify.forward_models import POISSON_OF_ELEMENTS
from explicitfe.inverse.identify.identify import LARGEST_POISSON_OF_ELEMENTS
from explicitfe.inverse.identify.laws import FIT_LAWS
from explicitfe.inverse.identify.pictures import GroupPictures
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.results.documents.identification import Identification, IdentifiedGroup
from explicitfe.results.files.folder import drawing, whole_folder

SUMMARY_FILE, PAGE_FILE = "identify.json", "identify.html"
LONGEST_SLUG_CHARACTERS = 60  # of a name in a file's name, which has 255 on most systems
LONGEST_PART_CHARACTERS = 130  # of the two parts of a scenario's title, which has 300


def write_identification(target: Path, identification: Identification, pictures: Mapping[str, GroupPictures]) -> None:
    """Write all files or none; ``identification["files"]`` lists them afterwards.

    Raises
    ------
    InputError : the folder cannot be written.
    """
    with whole_folder(target, summary=SUMMARY_FILE) as folder:
        _fill(folder, target, identification, pictures)


def _fill(folder: Path, target: Path, identification: Identification, pictures: Mapping[str, GroupPictures]) -> None:
    from explicitfe.app.view import fit as figures

    groups = identification["groups"]
    several = len(groups) > 1
    slugs = slugs_of(list(groups))
    names: list[str] = []

    def file(stem: str, group: str, ending: str) -> Path:
        names.append(f"{stem}{f'-{slugs[group]}' if several else ''}{ending}")
        return folder / names[-1]

    for name, shown in pictures.items():
        title = identification["dataset"] + (f", {name}" if several else "")
        with drawing(identification["warnings"]):
            axes = list(dict.fromkeys((curve["x_label"], curve["y_label"]) for curve in shown.curves))
            for number, labels in enumerate(axes, 1):
                alike = [curve for curve in shown.curves if (curve["x_label"], curve["y_label"]) == labels]
                figures.fit(file("fit" if number == 1 else f"fit-{number}", name, ".png"), title, alike, shown.constants)
            if shown.profiles is not None:
                figures.profiles(file("profiles", name, ".png"), title, shown.profiles)
            if shown.paper is not None:
                figures.convergence(file("convergence", name, ".png"), title, shown.paper)
            specimen = None if shown.test is None else shown.test.deform()
            if specimen is not None:
                figures.deformed(file("deformed", name, ".png"), title, specimen)
        if shown.test is not None:
            title = f"{identification['title'][:LONGEST_PART_CHARACTERS]}: constants {name[:LONGEST_PART_CHARACTERS]}, fitted"
            scenario = shown.test.scenario(title, identification["method"])
            file("fitted", name, ".toml").write_text(scenario, encoding="utf-8")
    materials = (_material(name, group, identification["poisson"]) for name, group in groups.items() if "constants" in group)
    curves = {name: shown.curves for name, shown in pictures.items()}
    profiles = {name: shown.profiles for name, shown in pictures.items() if shown.profiles is not None}
    names.append(PAGE_FILE)
    (folder / PAGE_FILE).write_text(identify_page(identification, curves, profiles), encoding="utf-8")
    (folder / "material.toml").write_text("".join(materials), encoding="utf-8")
    names.append("material.toml")
    names = [name for name in names if (folder / name).exists()]
    identification["files"] = [str(target / name) for name in [SUMMARY_FILE, *names]]
    (folder / SUMMARY_FILE).write_text(json_text(identification) + "\n", encoding="utf-8")


def slugs_of(names: Sequence[str]) -> dict[str, str]:
    """Name -> the part of a file name for it, unique also where names differ only in characters that are not allowed."""
    slugs: dict[str, str] = {}
    for name in names:
        plain_name = re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-.")[:LONGEST_SLUG_CHARACTERS] or "group"
        slug, number = plain_name, 1
        while slug.lower() in map(str.lower, slugs.values()):  # Some file systems ignore case.
            number += 1
            slug = f"{plain_name}-{number}"
        slugs[name] = slug
    return slugs


def _material(name: str, group: IdentifiedGroup, poisson: float) -> str:
    """A table of constants for the key ``material`` of a scenario."""
    values = "".join(f"{key} = {entry['value']:.6g}\n" for key, entry in group["constants"].items())
    law = FIT_LAWS[group["law"]].key
    ratio = f"{poisson:g}"
    if poisson > LARGEST_POISSON_OF_ELEMENTS:
        ratio = f"{POISSON_OF_ELEMENTS:g}  # of elements; the constants were fitted with {poisson:g}"
    return f"[{toml_value(name)}]\nlaw = {toml_value(law)}\n{values}poisson = {ratio}\n\n"
