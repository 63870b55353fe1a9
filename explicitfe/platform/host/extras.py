"""Packages that only some commands need, so that the core can be installed without them."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Literal

from explicitfe.platform.errors import InputError

Extra = Literal["view", "plots", "parquet", "pandas", "sensitivity", "cluster", "c3d"]

# The extra of pyproject.toml -> the package that stands for it.
PACKAGES: dict[Extra, str] = {
    "view": "pyvista",
    "plots": "matplotlib",
    "parquet": "pyarrow",
    "pandas": "pandas",
    "sensitivity": "SALib",
    "cluster": "distributed",
    "c3d": "c3d",
}


def has_extra(extra: Extra) -> bool:
    """Whether the packages of an extra are installed; nothing is imported."""
    return find_spec(PACKAGES[extra]) is not None


def require(extra: Extra, what: str) -> None:
    """Ask for the packages of an extra before anything long begins.

    Parameters
    ----------
    what : needs them; the beginning of a sentence, such as "drawing pictures".

    Raises
    ------
    InputError : they are not installed; says how to install them.
    """
    if not has_extra(extra):
        raise InputError(f"{what} needs {how_to_install(extra)}")


def how_to_install(extra: Extra) -> str:
    """The end of a sentence on an extra that is missing."""
    return f'{PACKAGES[extra]}, which is not installed: pip install ".[{extra}]" in its source folder'
