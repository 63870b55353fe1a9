"""The first half of the recordings of the dataset ``simulated-beam``: as many causes are seen in it, in half the time."""

from __future__ import annotations

import shutil
from pathlib import Path

from support import ROOT

BEAM = ROOT / "scenarios" / "datasets" / "simulated-beam"
ROWS = 77  # a head and 0.375 s, of 0.755 s


def short_beam(folder: Path) -> Path:
    """Write the dataset into a new folder."""
    shutil.copytree(BEAM, folder)
    for path in folder.glob("load*.csv"):
        path.write_text("\n".join(path.read_text(encoding="utf-8").splitlines()[:ROWS]) + "\n", encoding="utf-8")
    return folder
