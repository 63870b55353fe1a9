"""Viewpoints of a scene: named views, and the placement of the camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from explicitfe.platform.errors import InputError, nearest

if TYPE_CHECKING:
    import pyvista


@dataclass(frozen=True)
class Viewpoint:
    """A named view.

    Attributes
    ----------
    words : caption.
    towards_eye : (3,) direction from the body to the eye; x points backwards, y to the speaker's right, z up.
    up : (3,) what is above in the picture.
    cut : whether the half of the body before the midsagittal plane is cut away.
    before : (3,) normal of the plane that cuts bones, which do not hide the body in front of it; None: bones that lie
        before the body are left out.
    """

    words: str
    towards_eye: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    cut: bool = False
    before: tuple[float, float, float] | None = (0.0, -1.0, 0.0)

    @property
    def axes(self) -> np.ndarray:
        """(3, 3): to the right in the picture, up in it, and towards the eye; unit vectors by rows."""
        eye = np.array(self.towards_eye) / np.linalg.norm(self.towards_eye)
        right = np.cross(self.up, eye)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(eye, right), eye])


VIEWPOINTS = {
    "midsagittal": Viewpoint("cut at the midsagittal plane, front at the left", (0.0, -1.0, 0.0), cut=True),
    "side": Viewpoint("from the left", (0.0, -1.0, 0.0)),
    "front": Viewpoint("from the front", (-1.0, 0.0, 0.0), before=(-1.0, 0.0, 0.0)),
    "top": Viewpoint("from above, front at the left", (0.0, 0.0, 1.0), up=(0.0, 1.0, 0.0), before=None),
    "oblique": Viewpoint("from the front and the left", (-1.0, -0.75, 0.45)),
}


def viewpoint(name: str) -> Viewpoint:
    """The view of that name.

    Raises
    ------
    InputError : there is none.
    """
    if name not in VIEWPOINTS:
        raise InputError(f'"{name}" is not a viewpoint; {nearest(name, VIEWPOINTS)}')
    return VIEWPOINTS[name]


def aim(plotter: pyvista.Plotter, view: Viewpoint, points: np.ndarray, margins: tuple[float, float, float]) -> None:
    """Place the camera so that points (k, 3) fill the picture, in parallel projection.

    Parameters
    ----------
    margins : shares of the picture's height above and below the points, and of its width on either side, that stay free.
    """
    above, below, beside = margins
    right, up, eye = view.axes
    across, along, depth = points @ right, points @ up, points @ eye
    width_px, height_px = plotter.window_size
    # The half height of the picture in the points' unit, so that both directions have room.
    half = 0.5 * max(np.ptp(along) / (1.0 - above - below), np.ptp(across) / (1.0 - 2.0 * beside) * height_px / width_px)
    centre = np.array([0.5 * (part.min() + part.max()) for part in (across, along, depth)])
    centre[1] += half * (above - below)
    focus = centre @ view.axes
    distance = 2.0 * max(float(np.ptp(depth)), half)
    plotter.camera.parallel_projection = True
    plotter.camera_position = [focus + distance * eye, focus, up]
    plotter.camera.parallel_scale = half
    plotter.camera.clipping_range = (0.01 * distance, 3.0 * distance)
