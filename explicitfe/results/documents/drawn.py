"""Answers of ``explicitfe plot`` and ``explicitfe view``."""

from __future__ import annotations

from typing import NotRequired

from typing_extensions import TypedDict


class DrawnPictures(TypedDict):
    """The pictures of a result: their files, and a sentence for each that could not be drawn.

    ``results`` is there if the pictures show several results; ``result`` is then the first of them.
    """

    result: str
    results: NotRequired[list[str]]
    files: list[str]
    warnings: list[str]


class ShownScene(DrawnPictures):
    """A result in three dimensions: the view, the field that colours it, and the time of the picture, ms.

    ``files`` is empty if it was shown in a window. ``time_ms`` is the number of the load step of an indentation.
    """

    view: str
    field: str
    time_ms: float
