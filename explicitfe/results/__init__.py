"""Result files: one ``.vtkhdf`` a run, written as it goes, read by this package, h5py, ParaView and pyvista."""

from explicitfe.results.contents import FieldInfo, RestartState, StoredBone
from explicitfe.results.in_memory import ResultInMemory
from explicitfe.results.layout import FAILED, FINISHED, RUNNING, Quantity
from explicitfe.results.provenance import provenance
from explicitfe.results.reader import Result, open_result
from explicitfe.results.recorded import Recorded
from explicitfe.results.writer import ResultWriter

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
