"""What drawing a result came to: the answers of ``explicitfe plot`` and ``explicitfe view``."""

from __future__ import annotations

from typing_extensions import TypedDict


class DrawnPictures(TypedDict):
    """The pictures of a result: their files, and sentences on those that could not be drawn."""

    result: str
    files: list[str]
    warnings: list[str]


class ShownScene(DrawnPictures):
    """A result in three dimensions: from where it was seen, which field coloured it, and at which time the picture is, ms.

    ``files`` is empty where it was shown in a window. ``time_ms`` is the number of the load in an indentation.
    """

    view: str
    field: str
    time_ms: float
