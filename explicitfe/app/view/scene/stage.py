"""A scene with its annotations: title, time, muscles, colour scale and orientation."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from explicitfe.app.view.heading import title_of, variant_of
from explicitfe.app.view.muscles import muscles_of, pull_in_words
from explicitfe.app.view.palette import FIBRE_PULLING, drawable
from explicitfe.app.view.scene.scene import Look, Scene, mixed
from explicitfe.app.view.times import milliseconds
from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.files import Result

if TYPE_CHECKING:
    import pyvista

# Where words stand, as shares of the picture's width and height from its lower left corner, and how large they are there.
LEFT_SHARE, TITLE_SHARE, LINE_WIDTH_SHARE = 0.02, 0.945, 0.042
TEXT_SHARE, TITLE_LETTER_SHARE = 0.021, 0.027
SCALE_TITLE_PLACE = (0.345, 0.096)
# Room that the scene leaves free above and below it, and on either side.
FREE_MARGINS = (0.13, 0.15, 0.03)
TITLE_CHARACTERS, LINE_CHARACTERS = 74, 100
MOST_MUSCLES_NAMED = 8
# An axis is seen from its end where the cosine between it and the view is above this; how far along an arrow its name stands.
NEARLY_ALONG, LABEL_PLACE = 0.95, 2.1
ARROWS_ZOOM = 0.5  # leaves room to their names
VTK_FONT_FILE = 4  # VTK's number for letters of a file
# The words of a muscle that does not pull are darker than its fibres: letters are thin.
WORDS_AT_REST = "#737373"


class Stage:
    """A plotter with a scene and its annotations.

    Parameters
    ----------
    result, steps, look : as of a :class:`Scene`.
    size_px : width and height.
    window : whether it is to be seen on a screen.
    plotter : an empty one to use again; a new one if left out.

    Attributes
    ----------
    plotter : of pyvista.
    scene : what is shown.
    """

    def __init__(
        self,
        result: Result,
        steps: Sequence[int],
        look: Look,
        size_px: tuple[int, int],
        window: bool = False,
        plotter: Any | None = None,
    ) -> None:
        import pyvista

        self.result = result
        self.plotter: Any = plotter or pyvista.Plotter(
            off_screen=not window, window_size=list(size_px), lighting="light kit", title=f"explicitfe: {result.path.name}"
        )
        if plotter is not None:  # which was cleared, of its lights too
            plotter.enable_lightkit()
        self.plotter.background_color = "white"
        self.scene = Scene(result, steps, look, self.plotter)
        self.scene.aim(FREE_MARGINS)
        self._height_px = size_px[1]
        title = textwrap.shorten(title_of(result), TITLE_CHARACTERS, placeholder=" …")
        self._words(title, (LEFT_SHARE, TITLE_SHARE), TITLE_LETTER_SHARE, "black", bold=True)
        variant = variant_of(result)
        if variant:
            line = textwrap.shorten(variant, LINE_CHARACTERS, placeholder=" …")
            self._words(line, (LEFT_SHARE, TITLE_SHARE - LINE_WIDTH_SHARE), TEXT_SHARE, "#404040")
        below = TITLE_SHARE - LINE_WIDTH_SHARE * (2 if variant else 1)
        self._time = self._words(" ", (LEFT_SHARE, below), TEXT_SHARE, "black")
        self._muscles = {
            number: self._words(pull_in_words(muscle), (LEFT_SHARE, 0.02 + LINE_WIDTH_SHARE * line), TEXT_SHARE, WORDS_AT_REST)
            for line, (number, muscle) in enumerate(reversed([*enumerate(muscles_of(result))][:MOST_MUSCLES_NAMED]))
        }
        self._add_scale()
        self._add_orientation()

    def show(self, step: int) -> None:
        """Show a sample, with its time and the activation of the muscles."""
        self.scene.show(step)
        self._time.input = moment_in_words(self.result, step)
        for number, share in enumerate(self.scene.pulls(step)):
            if number in self._muscles:
                self._muscles[number].prop.color = mixed(WORDS_AT_REST, FIBRE_PULLING, share)

    def picture(self) -> np.ndarray:
        """The current picture, (height, width, 3) uint8."""
        self.plotter.render()
        image = self.plotter.screenshot(return_img=True)
        assert image is not None
        return image

    def add_keys(self, text: str) -> None:
        """Write the keys below the scene."""
        self._words(text, (0.34, 0.005), 0.7 * TEXT_SHARE, WORDS_AT_REST)

    def _words(
        self,
        text: str,
        place: tuple[float, float],
        height_share: float,
        colour: str,
        bold: bool = False,
    ) -> pyvista.Text:
        import pyvista

        actor = pyvista.Text(plain_words(text))
        actor.prop.set_font_file(font_file(bold))
        actor.prop.color = colour
        actor.prop.font_size = max(6, round(height_share * self._height_px))
        actor.GetPositionCoordinate().SetCoordinateSystemToNormalizedViewport()
        actor.GetPositionCoordinate().SetValue(*place)
        self.plotter.add_actor(actor, reset_camera=False)
        return actor

    def _add_scale(self) -> None:
        field = self.scene.field
        if field is None:
            return
        self._words(field.label, SCALE_TITLE_PLACE, TEXT_SHARE, "black")
        bar = self.plotter.add_scalar_bar(
            title="",
            n_labels=5,
            fmt="%.4g",
            position_x=0.34,
            position_y=0.02,
            width=0.42,
            height=0.075,
            label_font_size=round(TEXT_SHARE * self._height_px),
            color="black",
            unconstrained_font_size=True,
            mapper=self.scene.body_mapper,
        )
        bar.GetLabelTextProperty().SetFontFamily(VTK_FONT_FILE)
        bar.GetLabelTextProperty().SetFontFile(font_file())

    def _add_orientation(self) -> None:
        """Three arrows in the lower right corner: to the speaker's front and left, and up; those along the view have no name."""
        import pyvista

        along = np.abs(self.scene.view.axes[2]) > NEARLY_ALONG
        names = ["" if hidden else name for name, hidden in zip(("front", "left", "up"), along, strict=True)]
        arrows = pyvista.AxesAssembly(
            labels=names,
            x_color="#555555",
            y_color="#555555",
            z_color="#555555",
            label_color="black",
            label_size=round(1.1 * TEXT_SHARE * self._height_px),
            label_position=LABEL_PLACE,
            shaft_radius=0.04,
            tip_radius=0.14,
            orientation=(0.0, 0.0, 180.0),  # x of a model points backwards, y to the right
        )
        for part in arrows.parts:
            if isinstance(part, pyvista.Label):
                part.prop.set_font_file(font_file())
                part.prop.italic = part.prop.bold = part.prop.shadow = False
                part.prop.justification_horizontal = part.prop.justification_vertical = "center"
        widget = self.plotter.add_orientation_widget(arrows, interactive=False, viewport=(0.82, 0.0, 1.0, 0.225))
        widget.SetZoom(ARROWS_ZOOM)


def font_file(bold: bool = False) -> str:
    """Letters that know phonetic symbols: VTK's own do not, and draw brackets that look like parentheses."""
    import matplotlib

    return str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / f"DejaVuSans{'-Bold' * bold}.ttf")


def moment_in_words(result: Result, step: int) -> str:
    """Time of a sample, or load of an indentation, in words."""
    if kind_of(result.model) == "relaxation":
        force_N = float(result.history("force")[step])
        return f"load {step} of {len(result.times) - 1}: {force_N:.3g} N"
    return milliseconds(result.times[[step]], result.times[-1])[0]


def plain_words(text: str) -> str:
    """A text as it stands: VTK takes what is between two dollars for a formula."""
    return drawable(text).replace("$", "\\$")
