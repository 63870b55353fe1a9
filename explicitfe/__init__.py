"""explicitfe: explicit-dynamics simulator of the tongue and other soft tissue.

>>> import explicitfe
>>> summary = explicitfe.run("scenarios/vowel-i.toml", out="outputs")
>>> with explicitfe.open_result(summary["result"]) as result:
...     u = result.displacement(time_s=0.060)       # (n, 3) m
...     mesh = result.mesh_at(time_s=0.060)         # pyvista mesh

The commands are functions here; so are the parts that a model is built from in Python (docs/tutorials/python.md).
"""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import Any

__version__ = "0.1.0"

# Name -> the module that it is in. Imported on first use: a program that only reads results does not wait for the compiler, and a
# program that only simulates does not wait for what reads results.
_PLACES = {
    name: module
    for module, name in re.findall(r"^from (\S+) import (\w+) as", Path(__file__).with_suffix(".pyi").read_text("utf-8"), re.M)
}
__all__ = ["__version__", *_PLACES]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'explicitfe' has no attribute {name!r}")
    value = getattr(import_module(_PLACES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_PLACES})
