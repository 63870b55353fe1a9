"""Rigid registration of a sensor frame to the frame of a model."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from explicitfe.inverse.measured.tables import RegistrationTable
from explicitfe.platform.errors import InputError
from explicitfe.results.measure.sections import X, Y, Z

# Points within this share of their extent from a line do not determine a rotation about it.
LINE_SHARE = 1e-3
NARROW_SHARE = 0.1  # within this share the rotation is determined poorly
# A recording in named directions is turned relative to the model by no more than this. A larger rotation is one about the line on
# which the points nearly lie.
LARGEST_TURN_DEG = 45.0
# A recording is mirrored if its mirror image fits so much better, and its own distance is no matter of another anatomy.
MIRRORED_SHARE, MIRRORED_DISTANCE_M = 0.5, 2e-3
_AXES = ("front-to-back", "lateral", "vertical")


@dataclass(frozen=True, eq=False)
class Registration:
    """Transformation from the sensor frame to the model frame: x_model = scale R x + t.

    Attributes
    ----------
    rotation : (3, 3) R.
    translation : (3,) t [m].
    scale : of the model relative to the sensors.
    """

    rotation: np.ndarray
    translation: np.ndarray
    scale: float = 1.0

    def to_sensors(self, positions: np.ndarray) -> np.ndarray:
        """Transform positions (..., 3) m from the model frame to the sensor frame."""
        return (positions - self.translation) @ self.rotation / self.scale

    def to_model(self, positions: np.ndarray) -> np.ndarray:
        """Transform positions (..., 3) m from the sensor frame to the model frame."""
        return self.scale * positions @ self.rotation.T + self.translation

    @property
    def turn_deg(self) -> float:
        """Angle of the rotation in degrees."""
        return float(np.degrees(np.arccos(np.clip((np.trace(self.rotation) - 1.0) / 2.0, -1.0, 1.0))))

    @property
    def is_planar(self) -> bool:
        """Whether the rotation maps the midsagittal plane to itself."""
        return bool(abs(self.rotation[Y, Y]) == 1.0)

    @property
    def table(self) -> RegistrationTable:
        """The table ``[registration]`` of a dataset, with the translation in mm."""
        values = {
            "rotation": self.rotation.tolist(),
            "translation": (1e3 * self.translation).tolist(),
            "scale": float(self.scale),
        }
        return RegistrationTable.model_validate(values)


def procrustes(table: RegistrationTable, model: np.ndarray, seen: np.ndarray) -> Registration:
    """Fit the registration that minimizes the squared distances of paired points (Umeyama 1991, IEEE PAMI 13:376).

    Parameters
    ----------
    table : which parts are fitted ("fit"), and the values of the others.
    model, seen : (k, 3) m; the same points in the model frame and in the sensor frame.
    """
    free = table.translation == "fit"
    centre = model.mean(axis=0) if free else 1e-3 * np.array(table.translation)
    place = seen.mean(axis=0) if free else np.zeros(3)
    a, b = model - centre, seen - place
    scale = 1.0 if table.scale == "fit" else table.scale
    rotation = rotation_between(b, a) if table.rotation == "fit" else np.array(table.rotation)
    if table.scale == "fit":
        scale = float(np.sum(a * (b @ rotation.T)) / np.sum(b * b))
    return Registration(rotation, centre - scale * rotation @ place, scale)


def procrustes_in_plane(model: np.ndarray, seen: np.ndarray, reversed_x: bool = False) -> Registration:
    """Fit a translation and a rotation about the lateral axis (y) to paired points.

    Parameters
    ----------
    model, seen : (k, 3) m; the same points in the model frame and in the sensor frame.
    reversed_x : whether the x axis of the sensors points forward; they are then turned by 180° about the vertical axis first.
    """
    half_turn = np.diag([-1.0, -1.0, 1.0]) if reversed_x else np.eye(3)
    a, b = model - model.mean(axis=0), (seen - seen.mean(axis=0)) @ half_turn
    sine, cosine = np.sum(a[:, X] * b[:, Z] - a[:, Z] * b[:, X]), np.sum(a[:, X] * b[:, X] + a[:, Z] * b[:, Z])
    rotation = np.eye(3)
    rotation[np.ix_([X, Z], [X, Z])] = np.array([[cosine, sine], [-sine, cosine]]) / (np.hypot(sine, cosine) or 1.0)
    rotation = rotation @ half_turn
    return Registration(rotation, model.mean(axis=0) - rotation @ seen.mean(axis=0))


def turns_over(fitted: Registration, axes: str, planar: bool) -> bool:
    """Whether a fitted rotation contradicts the axes that a recording names.

    The squared distances of points that lie nearly on a line may be smallest if the recording is turned upside down about this
    line. In named directions up remains up; so it does in a planar recording, whose second axis is vertical.

    Parameters
    ----------
    axes, planar : as in :class:`explicitfe.inverse.measured.coils.Coils`.
    """
    if axes == "anatomical":
        return fitted.turn_deg > LARGEST_TURN_DEG
    return planar and bool(fitted.rotation[Z, Z] < np.cos(np.radians(LARGEST_TURN_DEG)))


def check_directions(
    path: Path, fitted: Registration, model: np.ndarray, seen: np.ndarray, sensors: np.ndarray, axes: str, planar: bool
) -> None:
    """Raise InputError if paired points fit only after a rotation that contradicts the axes of the recording, or mirrored.

    Parameters
    ----------
    fitted, model, seen : a free registration, and the points (k, 3) m that it was fitted to.
    sensors : (s, 3) mean positions; where they lie nearly on a line, a rotation about it says nothing.
    """
    advice = "correct the axes (`axes`) or `mapping`, or take another time at which the speaker rests"
    mirror = np.array([1.0, -1.0, 1.0])
    other = procrustes(RegistrationTable(rotation="fit", translation="fit"), model, seen * mirror)
    distance, mirrored = (
        float(np.sqrt(np.mean(np.sum((fit.to_model(points) - model) ** 2, axis=-1))))
        for fit, points in ((fitted, seen), (other, seen * mirror))
    )
    if distance > MIRRORED_DISTANCE_M and mirrored < MIRRORED_SHARE * distance:
        raise InputError(
            f"{path}: the recording is mirrored: its mirror image fits the model within {1e3 * mirrored:.2g} mm, itself within "
            f"{1e3 * distance:.2g} mm; {advice}."
        )
    if turns_over(fitted, axes, planar) and not are_nearly_on_a_line(sensors):
        turn = Rotation.from_matrix(fitted.rotation).as_rotvec(degrees=True)
        raise InputError(
            f"{path}: the recording fits the model only if it is turned by {fitted.turn_deg:.0f}°, mainly about the "
            f"{_AXES[int(np.abs(turn).argmax())]} axis; its axes allow {LARGEST_TURN_DEG:g}°. It is turned or mirrored, or "
            f"sensors are interchanged: {advice}."
        )


def rotation_between(from_: np.ndarray, to: np.ndarray) -> np.ndarray:
    """Proper rotations (..., 3, 3) that bring points (..., k, 3) nearest to others, both about the origin (Kabsch 1976)."""
    u, _, vt = np.linalg.svd(np.swapaxes(to, -1, -2) @ from_)
    u[..., -1] *= np.linalg.det(u @ vt)[..., None]
    rotation: np.ndarray = u @ vt
    return rotation


def are_nearly_on_a_line(points: np.ndarray) -> bool:
    """Whether points (k, 3) are so near a line that a rotation about this line is determined poorly."""
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(extents[1] < NARROW_SHARE * extents[0])


def determine_a_rotation(points: np.ndarray) -> bool:
    """Whether points (k, 3) do not lie on one line, so that a rotation can be fitted to them."""
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return len(points) > 2 and bool(extents[1] > LINE_SHARE * extents[0])
