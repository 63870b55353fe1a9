"""The heading of a picture of a run: its title, what tells it from others of its scenario, what is drawn, which muscles pull."""

from __future__ import annotations

import textwrap
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

from explicitfe.results import Result
from explicitfe.view.muscles import muscles_of, pull_in_words
from explicitfe.view.palette import WIDTH_IN, new_figure

LONGEST_HEADING_CHARACTERS = 400  # five lines: more of it would leave no room to the picture
SETTING_MARK = "# --set "  # before each setting at the head of a stored scenario

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def result_figure(result: Result, height_in: float, what: str) -> Figure:
    """An empty figure with a heading.

    Parameters
    ----------
    height_in : height of the figure where each part of the heading takes one line.
    what : what the picture shows, in words.

    What was set and the run's own name stand below the title: pictures of variants of a scenario can be told apart.
    """
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    title = textwrap.wrap(title_of(result), 88)
    second = ", ".join([what, *[pull_in_words(muscle) for muscle in muscles_of(result)]])
    if result.status not in ("finished", "running"):
        second += f"; the run ended early: {result.status}"
    variant = textwrap.shorten(variant_of(result), LONGEST_HEADING_CHARACTERS, placeholder=" …")
    lines = [*textwrap.wrap(variant, 110), *textwrap.wrap(second, 110)]
    figure = new_figure(WIDTH_IN, height_in + 0.2 * (len(title) + len(lines) - 2))
    layout = figure.get_layout_engine()
    assert isinstance(layout, ConstrainedLayoutEngine)
    layout.set(w_pad=0.08, h_pad=0.08)
    # The heading has two sizes of letters: the second part stands below the first, in the room that the empty lines of the first
    # keep free.
    figure.suptitle("\n".join(title) + "\n" * len(lines), fontsize=13, fontweight="bold", x=0.012, ha="left")
    below = 1.0 - (0.1 + 0.225 * len(title)) / figure.get_figheight()
    figure.text(0.012, below, "\n".join(lines), fontsize=10.5, color="0.25", va="top")
    return figure


def title_of(result: Result) -> str:
    """The title of a run; where its scenario has none or cannot be read, the name of the file. A very long one is cut."""
    title = result.summary.get("title")
    if not title:
        try:
            title = tomllib.loads(result.scenario_text).get("title", result.path.stem)
        except tomllib.TOMLDecodeError:
            title = result.path.stem
    return textwrap.shorten(str(title), LONGEST_HEADING_CHARACTERS, placeholder=" …")


def variant_of(result: Result) -> str:
    """What tells a run from others of its scenario: its name where it has one of its own, and what was set; may be empty."""
    header = []
    for line in result.scenario_text.splitlines():
        if not line.startswith(SETTING_MARK):
            break
        header.append(line.removeprefix(SETTING_MARK))
    scenario = Path(str(result.model.get("scenario_file", result.path.stem))).stem
    name = result.path.stem.removesuffix(".running")
    return ", ".join([*([name] if name != scenario else []), *header])


def rounded(value: float, count: int = 3) -> str:
    """A number with some significant digits and no exponent."""
    return f"{float(f'{value:.{count}g}'):.10g}"
