"""The files beside a scenario that its run is built from: which they are, and whether they are still as they were."""

from __future__ import annotations

import hashlib
from pathlib import Path

from explicitfe.platform.errors import InputError
from explicitfe.simulate.scenario.read import Scenario


def sums_of(path: Path, scenario: Scenario) -> dict[str, str]:
    """SHA-256 of each file that a scenario names, by the name it has there: model files, surfaces of bones.

    The mesh that a model file names is not among them: a result holds it whole.

    Raises
    ------
    InputError : a file cannot be read.
    """
    return {name: _sum(path.parent / name) for name in scenario.file_names}


def _sum(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path}: this cannot be read ({error.strerror})") from None
