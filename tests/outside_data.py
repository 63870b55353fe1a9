"""Data that are not in the repository: reference solutions of other programs, a real tongue's mesh, measured sets.

They stand in a folder ``shared/data`` beside the repository, or where ``EXPLICITFE_SHARED_DATA`` points. A clone of the
repository alone lacks them: the tests that need them are skipped, and say which folder or file is missing.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pytest import MarkDecorator

BESIDE = Path(__file__).resolve().parents[2] / "shared" / "data"
SHARED_DATA = Path(os.environ.get("EXPLICITFE_SHARED_DATA", BESIDE))


def needs(path: Path) -> MarkDecorator:
    """A mark for tests that need a file or a folder of these data."""
    import pytest  # A benchmark reads the data too, and does without pytest.

    name = path.relative_to(SHARED_DATA)
    return pytest.mark.skipif(not path.exists(), reason=f"needs {name} of the shared data, which are not in the repository")
