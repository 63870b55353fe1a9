"""A window with a scene that can be played, rotated, and seen from the named viewpoints."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from explicitfe.app.view.scene.film import FRAMES_PER_S, film_steps
from explicitfe.app.view.scene.scene import Look
from explicitfe.app.view.scene.stage import Stage
from explicitfe.results.files import Result, open_result
from explicitfe.results.measure.steps import step_at

FRAMES_OF_WINDOW = 200  # steps that can be shown: reading more takes longer than anybody waits
FRAME_MS = 1000 // FRAMES_PER_S
MOST_TICKS = 10**9
SLIDER_SHARE = 0.897  # how high the course of time stands in the window
# Key -> the view that it changes to, and the part of a look that it turns on or off.
VIEW_KEYS = {"m": "midsagittal", "s": "side", "f": "front", "t": "top", "o": "oblique"}
PART_KEYS = {"b": "bones", "x": "fibres", "r": "at_rest", "c": "context"}
KEYS_IN_WORDS = "space: play; left, right: one sample; m s f t o: viewpoint; b bones, x fibres, r rest, c context; q: close"


class Window:
    """A scene in a window: its keys, and the frame that is shown.

    Attributes
    ----------
    frame : number of the shown step in ``steps``.
    playing : whether the frames follow each other by themselves.
    """

    def __init__(
        self, result: Result, look: Look, size_px: tuple[int, int], time_s: float | None, *, on_screen: bool = True
    ) -> None:
        self._result, self._size_px, self._on_screen = result, size_px, on_screen
        self.steps = film_steps(result.times, step_at(result, time_s), FRAMES_OF_WINDOW)
        self.frame, self.playing, self.look = len(self.steps) - 1, False, look
        self._slider: list[Any] = []  # the one, where there is a screen
        self.stage = Stage(result, self.steps, look, size_px, window=on_screen)
        self._dress()

    @property
    def plotter(self) -> Any:
        """Of the stage."""
        return self.stage.plotter

    def go(self, frames: int) -> None:
        """So many frames on, from the last to the first."""
        self.frame = (self.frame + frames) % len(self.steps)
        self._show()

    def play(self) -> None:
        """Play, or stop."""
        self.playing = not self.playing

    def tick(self, tick: int = 0) -> None:
        """Show the next frame while it plays; called by a timer."""
        if self.playing:
            self.go(1)

    def change(self, **look: object) -> None:
        """Show the same sample with another look."""
        self.look = replace(self.look, **look)  # type: ignore[arg-type]
        self.plotter.suppress_rendering = True  # nobody is to see half a scene
        for slider in self._slider:
            slider.Off()
        self.plotter.clear()
        self.stage = Stage(self._result, self.steps, self.look, self._size_px, plotter=self.plotter)
        self._dress()
        self.plotter.suppress_rendering = False
        self.plotter.render()

    def keys(self) -> dict[str, Callable[[], None]]:
        """The function of each key."""
        actions: dict[str, Callable[[], None]] = {
            "space": self.play,
            "Left": lambda: self.go(-1),
            "Right": lambda: self.go(1),
            "q": self.plotter.close,
        }
        actions |= {key: lambda view=view: self.change(view=view) for key, view in VIEW_KEYS.items()}  # type: ignore[misc]
        actions |= {
            key: lambda part=part: self.change(**{part: not getattr(self.look, part)})  # type: ignore[misc]
            for key, part in PART_KEYS.items()
        }
        return actions

    def open(self) -> None:
        """Show the window until it is closed."""
        plotter = self.plotter
        plotter.iren.interactor.GetInteractorStyle().AddObserver("CharEvent", _nothing)  # VTK's own keys would act too
        for key, action in self.keys().items():
            plotter.add_key_event(key, action)
        plotter.add_timer_event(max_steps=MOST_TICKS, duration=FRAME_MS, callback=self.tick)
        plotter.show()

    def _dress(self) -> None:
        """What a window has beside its scene: the course of time, to be dragged, and what keys do."""
        self.stage.add_keys(KEYS_IN_WORDS)
        if self._on_screen:
            self._slider = [
                self.plotter.add_slider_widget(
                    self._drag,
                    (0, len(self.steps) - 1),
                    value=self.frame,
                    pointa=(0.3, SLIDER_SHARE),
                    pointb=(0.97, SLIDER_SHARE),
                    fmt="",
                    color="#555555",
                    slider_width=0.015,
                    tube_width=0.003,
                )
            ]
        self._show()

    def _drag(self, frame: float) -> None:
        self.frame = int(np.clip(round(frame), 0, len(self.steps) - 1))
        self.stage.show(self.steps[self.frame])

    def _show(self) -> None:
        self.stage.show(self.steps[self.frame])
        for slider in self._slider:
            slider.GetRepresentation().SetValue(self.frame)
        self.plotter.render()


def open_window(
    result: str, look: Mapping[str, object], size_px: Sequence[int], time_s: float | None, progress: Callable[[float], None]
) -> None:
    """Show a result in a window until that is closed; parameters as of :func:`explicitfe.app.view.scene.film.make_film`."""
    with open_result(result) as opened:
        Window(opened, Look(**look), (int(size_px[0]), int(size_px[1])), time_s).open()  # type: ignore[arg-type]
    progress(1.0)


def _nothing(*event: object) -> None:
    """In place of what VTK does for a key."""
