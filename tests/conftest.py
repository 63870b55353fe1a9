"""Makes ``tests/support.py`` and the benchmarks importable from every folder of tests, and the package from a plain checkout."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
for folder in (HERE, HERE.parent / "benchmarks", HERE.parent):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
