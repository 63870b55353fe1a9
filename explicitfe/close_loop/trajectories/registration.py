"""How the frame of the sensors lies to that of the model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from explicitfe.measured.tables import RegistrationTable


@dataclass(frozen=True, eq=False)
class Registration:
    """How the sensors' frame lies to the model's: x_model = scale R x + t.

    Attributes
    ----------
    rotation : (3, 3) R.
    centre, place : (3,) m; the same point in the model's frame and in that of the sensors.
    scale : of the model over the sensors.
    """

    rotation: np.ndarray
    centre: np.ndarray
    place: np.ndarray
    scale: float

    def to_sensors(self, positions: np.ndarray) -> np.ndarray:
        """Positions (..., 3) m of the model in the sensors' frame."""
        return (positions - self.centre) @ self.rotation / self.scale + self.place

    @property
    def table(self) -> RegistrationTable:
        """As a dataset states it."""
        shift = self.centre - self.scale * self.rotation @ self.place
        values = {"rotation": self.rotation.tolist(), "translation": (1e3 * shift).tolist(), "scale": float(self.scale)}
        return RegistrationTable.model_validate(values)


def procrustes(table: RegistrationTable, model: np.ndarray, seen: np.ndarray) -> Registration:
    """The registration that brings positions of a model nearest to measured ones (Umeyama 1991).

    Parameters
    ----------
    table : which parts are fitted, and what the others are.
    model, seen : (k, 3) m; the same points in the model and in the measurement.
    """
    free = table.translation == "fit"
    centre = model.mean(axis=0) if free else 1e-3 * np.array(table.translation)
    place = seen.mean(axis=0) if free else np.zeros(3)
    a, b = model - centre, seen - place
    scale = 1.0 if table.scale == "fit" else table.scale
    if table.rotation == "fit":
        U, _, Vt = np.linalg.svd(a.T @ b)
        rotation = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    else:
        rotation = np.array(table.rotation)
    if table.scale == "fit":
        scale = float(np.sum(a * (b @ rotation.T)) / np.sum(b * b))
    return Registration(rotation, centre, place, scale)
