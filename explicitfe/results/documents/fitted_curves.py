"""Numbers that the pictures of an identification show, in the units of the axes."""

from __future__ import annotations

from typing import Required

import numpy as np
from typing_extensions import TypedDict

from explicitfe.fem.mesh.hexmesh import HexMesh


class StatedTool(TypedDict, total=False):
    """A tool as a scenario states it."""

    shape: Required[str]
    radius_mm: float
    edge_radius_mm: float


class FittedCurve(TypedDict):
    """A measured curve and its model, in the units of the axes, each column (n,); ``split`` is "fit" or "holdout".

    ``sd`` is the noise of its rows, one standard deviation, and ``predicted`` the model at each row.
    """

    id: str
    split: str
    x_label: str
    y_label: str
    x: np.ndarray
    measured: np.ndarray
    line_x: np.ndarray
    line_y: np.ndarray
    sd: np.ndarray
    predicted: np.ndarray


class ConstantProfile(TypedDict):
    """Profile likelihood of a constant: the increase of chi squared over its values, divided by ``widened_by`` squared.

    Attributes
    ----------
    sd : standard error from independent noise alone.
    ci95 : 95 % interval, wider than from such noise alone by the factor ``widened_by``.
    """

    name: str
    best: float
    sd: float
    values: np.ndarray
    rise: np.ndarray
    ci95: tuple[float, float]
    widened_by: float


class PaperTrace(TypedDict):
    """The paper's iteration run by run: loads and measured displacements (k,), displacements (n, k), constants (n, 2) Pa."""

    loads_N: np.ndarray
    measured_mm: np.ndarray
    displacements_mm: np.ndarray
    constants: np.ndarray


class DeformedSpecimen(TypedDict):
    """A specimen under its tool: energy densities of the elements (m,), height of the tool's lowest point, load in words."""

    mesh: HexMesh
    displacement_m: np.ndarray
    energy_Pa: np.ndarray
    tool: StatedTool
    lowest_mm: float
    load: str
