"""Colours and sizes of all pictures; opening a figure and writing it to a file."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from explicitfe.results.files.folder import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# 1600 dots wide: a picture fills a page or a screen.
WIDTH_IN = 10.0
DOTS_PER_INCH = 160
# Control characters but the end of a line, and halves of characters: a name of a file may hold them.
NOT_DRAWABLE = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\ud800-\udfff]")
LONGEST_LINE_CHARACTERS = 200  # across the widest picture; more would leave no room to what is drawn
FORMATS = ("png", "pdf", "svg")
# How figures are written: no formulas, letters in a PDF as journals want them, the same names in the same SVG.
AS_FILE: Mapping[Any, Any] = {"text.parse_math": False, "pdf.fonttype": 42, "svg.hashsalt": "explicitfe"}
# Okabe and Ito's colours, told apart with every kind of colour blindness; their yellow is too pale for a line.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "black")
# A model before and after effects were added to it; style.css of the report says the same.
BEFORE, AFTER = COLOURS[1], COLOURS[0]
LINE_STYLES = ("-", "--", ":", "-.")
GREY, HELD, GRID = "0.55", "black", "0.88"
BONE, BONE_EDGE, CONSTRICTION = "#EFE6D2", "#8C7B5A", COLOURS[1]
# In a mouth: the tongue where no field colours it, what covers the bones, and teeth.
TONGUE, MUCOSA, IVORY = "#C8706A", "#E3C0B2", "#F7F3E4"
# Around it: lips, epiglottis and larynx.
LIP, CARTILAGE = "#D9A199", "#D8C7AE"
# A muscle fibre without tension, and with all the force of its muscle.
FIBRE_AT_REST, FIBRE_PULLING = "#C9C9C9", "#D1003F"
# Little energy is pale and much is dark; the order can be seen with every kind of colour blindness.
ENERGY_MAP = "cividis_r"


def new_figure(width_in: float, height_in: float, dots_per_inch: int = DOTS_PER_INCH) -> Figure:
    """An empty figure whose parts make room for each other."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), dpi=dots_per_inch, layout="constrained")


def use_plain_text(figure: Figure) -> None:
    """Draw every text of a figure literally: a dollar sign begins no formula."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        text.set_parse_math(False)
        text.set_text("\n".join(drawable(line) for line in text.get_text().split("\n")))


def save(figure: Figure, path: Path) -> None:
    """Write a figure as a whole, as PNG, PDF or SVG by the end of its name, with every text as it stands.

    A dollar begins no formula. ``Figure.savefig`` would draw the figure twice, once only for the layout.
    """
    from matplotlib import rc_context

    use_plain_text(figure)
    buffer = io.BytesIO()
    # Texts that are only made when the figure is drawn, such as numbers on axes, are no formulas either.
    with warnings.catch_warnings(), rc_context(dict(AS_FILE)):
        # Nobody chose the font: a letter that it lacks is drawn as a box, which is seen.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        _write(figure, buffer, path.suffix.removeprefix("."))
    whole_file(path, buffer.getvalue())


def _write(figure: Figure, buffer: io.BytesIO, file_format: str) -> None:
    """The bytes of a figure; without the time of day, so that the same picture is the same file."""
    if file_format == "pdf":
        from matplotlib.backends.backend_pdf import FigureCanvasPdf

        FigureCanvasPdf(figure).print_pdf(buffer, metadata={"CreationDate": None})
    elif file_format == "svg":
        from matplotlib.backends.backend_svg import FigureCanvasSVG

        FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None})
    else:
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        FigureCanvasAgg(figure).print_png(buffer)


def drawable(line: str) -> str:
    """A line for pictures: without control characters, and cut if it is too long."""
    line = NOT_DRAWABLE.sub("\N{REPLACEMENT CHARACTER}", line)
    return line if len(line) <= LONGEST_LINE_CHARACTERS else f"{line[: LONGEST_LINE_CHARACTERS - 1]}…"


def plain(axes: Axes) -> None:
    """Give a panel a light grid behind what is drawn, and no frame at the top and at the right."""
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def sequence(count: int) -> list[tuple[float, float, float, float] | str]:
    """Colours of successive times, from light to dark so that the last stands out; every kind of colour vision can read them."""
    from matplotlib import colormaps

    shares = np.linspace(0.12, 1.0, count) if count > 1 else np.ones(count)
    return [colormaps["viridis_r"](share) for share in shares]
