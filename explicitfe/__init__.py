"""explicitfe: explicit-dynamics simulator of the tongue and other soft tissue.

>>> import explicitfe
>>> summary = explicitfe.run("scenarios/vowel-i.toml", out="outputs")
>>> with explicitfe.open_result(summary["result"]) as result:
...     u = result.displacement(time_s=0.060)       # (n, 3) m
...     mesh = result.mesh_at(time_s=0.060)         # pyvista mesh

The commands are functions here; so are the parts that a model is built from in Python (docs/tutorials/python.md).
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

# Name -> the module that it stands in. Imported on first use: a program that only reads results does not wait for the compiler,
# nor the other way round.
_PLACES = {
    # commands
    "run": "explicitfe.app.api.run",
    "resume": "explicitfe.app.api.run",
    "save": "explicitfe.app.api.run",
    "sweep": "explicitfe.app.api.sweep",
    "SweepDesign": "explicitfe.app.api.sweep",
    "SweepExecution": "explicitfe.app.api.sweep",
    "gradient": "explicitfe.simulate.sweep.gradient",
    "check": "explicitfe.simulate.run.check",
    "check_dataset": "explicitfe.inverse.close_loop.outlook",
    "identify": "explicitfe.app.api.inverse",
    "predict": "explicitfe.app.api.inverse",
    "close_loop": "explicitfe.app.api.inverse",
    "design_test": "explicitfe.app.api.inverse",
    "propose_tests": "explicitfe.app.api.inverse",
    # results
    "open_result": "explicitfe.app.api.open_result",
    "measure": "explicitfe.app.api.measure",
    "report": "explicitfe.app.api.report",
    "plot": "explicitfe.app.api.plot",
    "view": "explicitfe.app.api.view",
    "compare": "explicitfe.app.api.compare",
    "compare_recording": "explicitfe.inverse.measured.compare_recording",
    "export": "explicitfe.app.api.export",
    # meshes and models
    "HexMesh": "explicitfe.fem.mesh.hexmesh",
    "box": "explicitfe.fem.mesh.box",
    "Yeoh": "explicitfe.fem.materials.yeoh",
    "NeoHooke": "explicitfe.fem.materials.neo_hooke",
    "MooneyRivlin": "explicitfe.fem.materials.mooney_rivlin",
    "Ogden": "explicitfe.fem.materials.ogden",
    "Model": "explicitfe.fem.model.model",
    "Bone": "explicitfe.fem.model.model",
    "Inclusion": "explicitfe.fem.model.model",
    "tongue_model": "explicitfe.simulate.anatomy.tongue",
    "specimen_model": "explicitfe.simulate.anatomy.specimen",
    "SpecimenTable": "explicitfe.fem.inputs.specimen",
    "ToolTable": "explicitfe.fem.inputs.specimen",
    # effects of the material, and extensions
    "Viscoelastic": "explicitfe.fem.effects.material.viscoelastic",
    "NonlinearRelaxation": "explicitfe.fem.effects.material.nonlinear_relaxation",
    "PowerLaw": "explicitfe.fem.effects.material.power_law",
    "Fractional": "explicitfe.fem.effects.material.fractional",
    "Softening": "explicitfe.fem.effects.material.softening",
    "PermanentSet": "explicitfe.fem.effects.material.permanent_set",
    "Payne": "explicitfe.fem.effects.material.payne",
    "ThirdYeoh": "explicitfe.fem.effects.material.third_yeoh",
    "Fibres": "explicitfe.fem.effects.material.fibres",
    "Compressible": "explicitfe.fem.effects.material.compressible",
    "Drainage": "explicitfe.fem.effects.material.drainage",
    "DiscoveredLaw": "explicitfe.fem.effects.material.discovered_law",
    "register_law": "explicitfe.fem.inputs.extensions",
    "register_effect": "explicitfe.fem.inputs.extensions",
    # loads
    "NodalLoad": "explicitfe.fem.model.model",
    "face_load": "explicitfe.fem.model.face_load",
    "gravity_load": "explicitfe.fem.model.gravity",
    "AttachedMass": "explicitfe.fem.model.attached",
    "SurfaceContact": "explicitfe.fem.model.surface_contact",
    "FollowerLoad": "explicitfe.fem.model.attached",
    "HangingWeight": "explicitfe.fem.model.attached",
    "AirDrag": "explicitfe.fem.model.attached",
    "Profile": "explicitfe.fem.model.profile",
    # solvers
    "Simulation": "explicitfe.fem.solve.simulation",
    "Transient": "explicitfe.fem.solve.transient",
    "Relaxation": "explicitfe.fem.solve.equilibrium",
    # what is raised
    "InputError": "explicitfe.platform.errors",
    "RunError": "explicitfe.platform.errors",
}
__all__ = ["__version__", *_PLACES]

if TYPE_CHECKING:  # the same names for type checkers and editors; a test compares the two lists
    from explicitfe.app.api.compare import compare as compare
    from explicitfe.app.api.export import export as export
    from explicitfe.app.api.inverse import close_loop as close_loop
    from explicitfe.app.api.inverse import design_test as design_test
    from explicitfe.app.api.inverse import identify as identify
    from explicitfe.app.api.inverse import predict as predict
    from explicitfe.app.api.inverse import propose_tests as propose_tests
    from explicitfe.app.api.measure import measure as measure
    from explicitfe.app.api.open_result import open_result as open_result
    from explicitfe.app.api.plot import plot as plot
    from explicitfe.app.api.report import report as report
    from explicitfe.app.api.run import resume as resume
    from explicitfe.app.api.run import run as run
    from explicitfe.app.api.run import save as save
    from explicitfe.app.api.sweep import SweepDesign as SweepDesign
    from explicitfe.app.api.sweep import SweepExecution as SweepExecution
    from explicitfe.app.api.sweep import sweep as sweep
    from explicitfe.app.api.view import view as view
    from explicitfe.fem.effects.material.compressible import Compressible as Compressible
    from explicitfe.fem.effects.material.discovered_law import DiscoveredLaw as DiscoveredLaw
    from explicitfe.fem.effects.material.drainage import Drainage as Drainage
    from explicitfe.fem.effects.material.fibres import Fibres as Fibres
    from explicitfe.fem.effects.material.fractional import Fractional as Fractional
    from explicitfe.fem.effects.material.nonlinear_relaxation import NonlinearRelaxation as NonlinearRelaxation
    from explicitfe.fem.effects.material.payne import Payne as Payne
    from explicitfe.fem.effects.material.permanent_set import PermanentSet as PermanentSet
    from explicitfe.fem.effects.material.power_law import PowerLaw as PowerLaw
    from explicitfe.fem.effects.material.softening import Softening as Softening
    from explicitfe.fem.effects.material.third_yeoh import ThirdYeoh as ThirdYeoh
    from explicitfe.fem.effects.material.viscoelastic import Viscoelastic as Viscoelastic
    from explicitfe.fem.inputs.extensions import register_effect as register_effect
    from explicitfe.fem.inputs.extensions import register_law as register_law
    from explicitfe.fem.inputs.specimen import SpecimenTable as SpecimenTable
    from explicitfe.fem.inputs.specimen import ToolTable as ToolTable
    from explicitfe.fem.materials.mooney_rivlin import MooneyRivlin as MooneyRivlin
    from explicitfe.fem.materials.neo_hooke import NeoHooke as NeoHooke
    from explicitfe.fem.materials.ogden import Ogden as Ogden
    from explicitfe.fem.materials.yeoh import Yeoh as Yeoh
    from explicitfe.fem.mesh.box import box as box
    from explicitfe.fem.mesh.hexmesh import HexMesh as HexMesh
    from explicitfe.fem.model.attached import AirDrag as AirDrag
    from explicitfe.fem.model.attached import AttachedMass as AttachedMass
    from explicitfe.fem.model.attached import FollowerLoad as FollowerLoad
    from explicitfe.fem.model.attached import HangingWeight as HangingWeight
    from explicitfe.fem.model.face_load import face_load as face_load
    from explicitfe.fem.model.gravity import gravity_load as gravity_load
    from explicitfe.fem.model.model import Bone as Bone
    from explicitfe.fem.model.model import Inclusion as Inclusion
    from explicitfe.fem.model.model import Model as Model
    from explicitfe.fem.model.model import NodalLoad as NodalLoad
    from explicitfe.fem.model.profile import Profile as Profile
    from explicitfe.fem.model.surface_contact import SurfaceContact as SurfaceContact
    from explicitfe.fem.solve.equilibrium import Relaxation as Relaxation
    from explicitfe.fem.solve.simulation import Simulation as Simulation
    from explicitfe.fem.solve.transient import Transient as Transient
    from explicitfe.inverse.close_loop.outlook import check_dataset as check_dataset
    from explicitfe.inverse.measured.compare_recording import compare_recording as compare_recording
    from explicitfe.platform.errors import InputError as InputError
    from explicitfe.platform.errors import RunError as RunError
    from explicitfe.simulate.anatomy.specimen import specimen_model as specimen_model
    from explicitfe.simulate.anatomy.tongue import tongue_model as tongue_model
    from explicitfe.simulate.run.check import check as check
    from explicitfe.simulate.sweep.gradient import gradient as gradient


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'explicitfe' has no attribute {name!r}")
    value = getattr(import_module(_PLACES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_PLACES})
