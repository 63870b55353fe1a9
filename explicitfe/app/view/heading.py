"""Headings of pictures of runs: title, variant of the scenario, contents of the picture, active muscles."""

from __future__ import annotations

import textwrap
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from explicitfe.app.view.muscles import muscles_of, pull_in_words
from explicitfe.app.view.palette import WIDTH_IN, new_figure
from explicitfe.results.files import Result
from explicitfe.results.files.differing_keys import differing_keys, table_in_words

LONGEST_HEADING_CHARACTERS = 400  # five lines: a longer heading would leave no room for the picture
LONGEST_STEM_CHARACTERS = 120
SETTING_MARK = "# --set "  # before each setting at the head of a stored scenario

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def result_figure(result: Result, height_in: float, what: str) -> Figure:
    """An empty figure with a heading.

    Parameters
    ----------
    height_in : height of the figure where each part of the heading takes one line.
    what : contents of the picture, in words.

    The settings and the name of the run are below the title, so that pictures of variants of a scenario are distinguishable.
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
    # The heading has two font sizes: empty lines of the first part leave the space for the second.
    figure.suptitle("\n".join(title) + "\n" * len(lines), fontsize=13, fontweight="bold", x=0.012, ha="left")
    below = 1.0 - (0.1 + 0.225 * len(title)) / figure.get_figheight()
    figure.text(0.012, below, "\n".join(lines), fontsize=10.5, color="0.25", va="top")
    return figure


def heading_of_several(results: Sequence[Result], height_in: float, what: str) -> Figure:
    """An empty figure with a heading for several results: the picture, their names, and the keys in which they differ."""
    names = labels_of([result.path for result in results])
    keys = differing_keys([result.model.get("scenario", {}) for result in results])
    differing = "; ".join(f"{key}: {', '.join(map(_short_value, values))}" for key, values in keys.items())
    lines = textwrap.wrap(textwrap.shorten(differing, LONGEST_HEADING_CHARACTERS // 2, placeholder=" …"), 110)
    title = textwrap.wrap(f"{what}: {', '.join(names)}", 88)
    figure = new_figure(WIDTH_IN, height_in + 0.2 * (len(title) + len(lines)))
    figure.suptitle("\n".join(title) + "\n" * len(lines), fontsize=13, fontweight="bold", x=0.012, ha="left")
    below = 1.0 - (0.1 + 0.225 * len(title)) / figure.get_figheight()
    figure.text(0.012, below, "\n".join(lines), fontsize=10.5, color="0.25", va="top")
    return figure


def _short_value(value: object) -> str:
    if value is None:
        return "absent"
    if isinstance(value, dict):
        return table_in_words(value)
    return rounded(value) if isinstance(value, float) else textwrap.shorten(str(value), 30, placeholder="…")


def labels_of(paths: Sequence[Path]) -> list[str]:
    """A unique short name for each result: its file's name, with as many folders as necessary, or with a number."""
    for depth in range(1, 1 + max(len(path.parts) for path in paths)):
        labels = ["/".join([*path.parts[-depth:-1], path.stem]) for path in paths]
        if len(set(labels)) == len(labels):
            return labels
    return [f"{path.stem} ({number})" for number, path in enumerate(paths, 1)]


def common_stem(paths: Sequence[Path]) -> str:
    """The beginning of the name of a file that shows several results; a long one names the first two and the number of others."""
    stems = [path.stem for path in paths]
    shown = "-".join(stems)
    return (
        shown
        if len(shown) <= LONGEST_STEM_CHARACTERS
        else f"{'-'.join(stems[:2])[:LONGEST_STEM_CHARACTERS]}-and-{len(stems) - 2}-more"
    )


def title_of(result: Result) -> str:
    """The title of a run, cut if it is very long; the name of the file if the scenario has no title or cannot be read."""
    title = result.summary.get("title")
    if not title:
        try:
            title = tomllib.loads(result.scenario_text).get("title", result.path.stem)
        except tomllib.TOMLDecodeError:
            title = result.path.stem
    return textwrap.shorten(str(title), LONGEST_HEADING_CHARACTERS, placeholder=" …")


def variant_of(result: Result) -> str:
    """The variant of a scenario: the name of the run if it differs from that of the scenario, and its settings; may be empty."""
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
