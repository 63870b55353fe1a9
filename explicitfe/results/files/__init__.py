"""Result files: one ``.vtkhdf`` a run, written as it goes, read by this package, h5py, ParaView and pyvista."""

from explicitfe.results.files.contents import FieldInfo, RestartState, StoredBone
from explicitfe.results.files.in_memory import ResultInMemory
from explicitfe.results.files.layout import FAILED, FINISHED, RUNNING, Quantity
from explicitfe.results.files.provenance import provenance
from explicitfe.results.files.reader import Result, open_result
from explicitfe.results.files.recorded import Recorded
from explicitfe.results.files.writer import ResultWriter

__all__ = [
    "FAILED",
    "FINISHED",
    "RUNNING",
    "FieldInfo",
    "Quantity",
    "Recorded",
    "RestartState",
    "Result",
    "ResultInMemory",
    "ResultWriter",
    "StoredBone",
    "open_result",
    "provenance",
]
