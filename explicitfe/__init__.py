"""explicitfe: explicit-dynamics simulator of the tongue and other soft tissue.

>>> import explicitfe
>>> summary = explicitfe.run("scenarios/vowel-i.toml", out="outputs")
>>> with explicitfe.open_result(summary["result"]) as result:
...     u = result.displacement(time_s=0.060)       # (n, 3) m
...     mesh = result.mesh_at(time_s=0.060)         # pyvista mesh

The commands are functions here; so are the parts that a model is built from in Python (docs/tutorials/python.md).
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

# Name -> the module that it stands in. Imported on first use: a program that only reads results does not wait for the compiler,
# nor the other way round.
_PLACES = {
    # commands
    "run": "explicitfe.api.run",
    "resume": "explicitfe.api.run",
    "sweep": "explicitfe.sweep.sweep",
    "check": "explicitfe.run.check",
    "check_dataset": "explicitfe.close_loop.outlook",
    "identify": "explicitfe.identify.identify",
    "predict": "explicitfe.predict.predict",
    "close_loop": "explicitfe.close_loop.close",
    "design_test": "explicitfe.close_loop.design",
    # results
    "open_result": "explicitfe.api.open_result",
    "measure": "explicitfe.api.measure",
    "report": "explicitfe.api.report",
    "plot": "explicitfe.api.plot",
    "view": "explicitfe.api.view",
    "compare": "explicitfe.api.compare",
    "compare_recording": "explicitfe.measured.compare_recording",
    "export": "explicitfe.api.export",
    # meshes and models
    "HexMesh": "explicitfe.mesh.hexmesh",
    "box": "explicitfe.mesh.box",
    "Yeoh": "explicitfe.materials.yeoh",
    "NeoHooke": "explicitfe.materials.neo_hooke",
    "MooneyRivlin": "explicitfe.materials.mooney_rivlin",
    "Ogden": "explicitfe.materials.ogden",
    "Model": "explicitfe.model.model",
    "Inclusion": "explicitfe.model.model",
    "tongue_model": "explicitfe.model.tongue",
    "specimen_model": "explicitfe.model.specimen",
    "SpecimenTable": "explicitfe.scenario.indentation",
    "ToolTable": "explicitfe.scenario.indentation",
    # loads
    "NodalLoad": "explicitfe.model.model",
    "face_load": "explicitfe.model.face_load",
    "gravity_load": "explicitfe.model.gravity",
    "Profile": "explicitfe.model.profile",
    # solvers
    "Simulation": "explicitfe.solve.simulation",
    "Transient": "explicitfe.solve.transient",
    "Relaxation": "explicitfe.solve.equilibrium",
    # what is raised
    "InputError": "explicitfe.errors",
    "RunError": "explicitfe.errors",
}
__all__ = ["__version__", *_PLACES]

if TYPE_CHECKING:  # the same names for type checkers and editors; a test compares the two lists
    from explicitfe.api.compare import compare as compare
    from explicitfe.api.export import export as export
    from explicitfe.api.measure import measure as measure
    from explicitfe.api.open_result import open_result as open_result
    from explicitfe.api.plot import plot as plot
    from explicitfe.api.report import report as report
    from explicitfe.api.run import resume as resume
    from explicitfe.api.run import run as run
    from explicitfe.api.view import view as view
    from explicitfe.close_loop.close import close_loop as close_loop
    from explicitfe.close_loop.design import design_test as design_test
    from explicitfe.close_loop.outlook import check_dataset as check_dataset
    from explicitfe.errors import InputError as InputError
    from explicitfe.errors import RunError as RunError
    from explicitfe.identify.identify import identify as identify
    from explicitfe.materials.mooney_rivlin import MooneyRivlin as MooneyRivlin
    from explicitfe.materials.neo_hooke import NeoHooke as NeoHooke
    from explicitfe.materials.ogden import Ogden as Ogden
    from explicitfe.materials.yeoh import Yeoh as Yeoh
    from explicitfe.measured.compare_recording import compare_recording as compare_recording
    from explicitfe.mesh.box import box as box
    from explicitfe.mesh.hexmesh import HexMesh as HexMesh
    from explicitfe.model.face_load import face_load as face_load
    from explicitfe.model.gravity import gravity_load as gravity_load
    from explicitfe.model.model import Inclusion as Inclusion
    from explicitfe.model.model import Model as Model
    from explicitfe.model.model import NodalLoad as NodalLoad
    from explicitfe.model.profile import Profile as Profile
    from explicitfe.model.specimen import specimen_model as specimen_model
    from explicitfe.model.tongue import tongue_model as tongue_model
    from explicitfe.predict.predict import predict as predict
    from explicitfe.run.check import check as check
    from explicitfe.scenario.indentation import SpecimenTable as SpecimenTable
    from explicitfe.scenario.indentation import ToolTable as ToolTable
    from explicitfe.solve.equilibrium import Relaxation as Relaxation
    from explicitfe.solve.simulation import Simulation as Simulation
    from explicitfe.solve.transient import Transient as Transient
    from explicitfe.sweep.sweep import sweep as sweep


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

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *_PLACES})


sys.modules[__name__].__class__ = _Package
