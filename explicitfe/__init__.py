"""explicitfe: explicit-dynamics simulator of the tongue and other soft tissue.

>>> import explicitfe
>>> summary = explicitfe.run("scenarios/vowel-i.toml", out="outputs")
>>> with explicitfe.open_result(summary["result"]) as result:
...     u = result.displacement(time_s=0.060)       # (n, 3) m
...     mesh = result.mesh_at(time_s=0.060)         # pyvista mesh
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

__version__ = "0.1.0"

# Imported on first use: a program that only reads results does not wait for the compiler, nor the other way round.
_PLACES = {
    "run": "explicitfe.run.run",
    "identify": "explicitfe.identify.identify",
    "predict": "explicitfe.predict.predict",
    "close_loop": "explicitfe.close_loop.close",
    "design_test": "explicitfe.close_loop.design",
    "open_result": "explicitfe.results",
    "InputError": "explicitfe.errors",
    "RunError": "explicitfe.errors",
}
__all__ = ["InputError", "RunError", "__version__", "close_loop", "design_test", "identify", "open_result", "predict", "run"]


class _Package(ModuleType):
    """This package: a command and the folder of its code have one name, and the name here is the command's.

    Importing ``explicitfe.run`` for the first time would make the folder an attribute of the package, and ``explicitfe.run(...)``
    would call a module from then on.
    """

    def __getattr__(self, name: str) -> Any:
        if name not in _PLACES:
            raise AttributeError(f"module 'explicitfe' has no attribute {name!r}")
        return getattr(import_module(_PLACES[name]), name)

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _PLACES and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
