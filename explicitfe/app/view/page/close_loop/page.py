"""The report of a closed loop: one page that a person understands in a minute, with its pictures as files next to it.

Any key of the report may be missing, any number not finite: then a dash stands on the page, or nothing. The page holds its
pictures and its style sheet and runs nothing, so that it is whole without a network and in an e-mail.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from explicitfe.app.view.page.close_loop import parts
from explicitfe.app.view.page.close_loop.motion_charts import marker_charts
from explicitfe.app.view.page.close_loop.motion_film import FILM_WIDTH_IN, motion_film
from explicitfe.app.view.page.close_loop.motion_tables import motion_on_page
from explicitfe.app.view.page.close_loop.pictures import before_after, causes, residuals, sensitivity
from explicitfe.app.view.page.close_loop.reading import DrawnCurve, assumed_values, drawn_curves, has_changed
from explicitfe.app.view.page.frame import page_text
from explicitfe.app.view.page.words import smooth_part
from explicitfe.app.view.palette import save
from explicitfe.results.documents.loop_report import LoopReport, ReportCurve
from explicitfe.results.documents.motion_report import MovingMarkers
from explicitfe.results.files.folder import whole_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE_FILE = "report.html"
FILM_FILE, MARKERS_FILE = "motion.gif", "markers.png"
CSS_DOTS_PER_INCH = 96


@dataclass(frozen=True)
class EmbeddedPicture:
    """A picture as it stands in the page: a file in base 64, the width it is shown with, and its format."""

    base64: str
    width_px: str
    file_format: str = "png"


@dataclass(frozen=True)
class EmbeddedPictures:
    """The pictures of the page; None where one has nothing to show."""

    causes: EmbeddedPicture | None = None
    before_after: EmbeddedPicture | None = None
    residuals: EmbeddedPicture | None = None
    sensitivity: EmbeddedPicture | None = None
    motion: EmbeddedPicture | None = None
    markers: EmbeddedPicture | None = None


def write(folder: Path, report: LoopReport, curves: Sequence[ReportCurve], markers: Sequence[MovingMarkers] = ()) -> list[str]:
    """Write the page and its pictures into ``folder``, and return the names of the files."""
    drawn = drawn_curves(curves)
    probabilities = _embedded(folder / "causes.png", causes(report))
    first = _embedded(folder / "before-after.png", before_after(report, drawn))
    left = _embedded(folder / "residuals.png", residuals(report, drawn))
    assumed = _embedded(folder / "sensitivity.png", sensitivity(report)) if assumed_values(report) else None
    pictures = EmbeddedPictures(
        probabilities,
        first if drawn else None,
        left if drawn else None,
        assumed,
        *_embed_motion(folder, report, markers),
    )
    (folder / PAGE_FILE).write_text(html(report, drawn, pictures), encoding="utf-8")
    optional = {"sensitivity.png": assumed, FILM_FILE: pictures.motion, MARKERS_FILE: pictures.markers}
    return [PAGE_FILE, "causes.png", "before-after.png", "residuals.png", *(name for name, one in optional.items() if one)]


def html(report: LoopReport, curves: Sequence[DrawnCurve], pictures: EmbeddedPictures) -> str:
    """The text of the page, from ``page.html.j2`` and ``style.css`` beside this file."""
    first = parts.first_screen(report)
    return page_text(
        "page/close_loop/page.html.j2",
        styles=["page/close_loop/style.css"],
        title=f"{report.dataset or report.title or 'closed loop'}: {first.headline}",
        pictures=pictures,
        first=first,
        curves_alternative=parts.curves_alternative(report),
        residual_caption=parts.residual_caption(curves),
        smooth_part=smooth_part(report),
        is_changed=has_changed(report),
        causes=parts.causes(report),
        not_testable=parts.not_testable(report),
        hypotheses=parts.hypotheses(report),
        next_tests=parts.next_tests(report),
        errors=parts.curve_errors(report),
        constants=parts.constants(report),
        motion=motion_on_page(report),
        noise=parts.noise(report),
        assumed=parts.assumed(report),
        split=parts.split(report),
        warnings=[text for text in report.warnings if text],
        provenance=parts.provenance(report),
    )


def _embedded(path: Path, figure: Figure) -> EmbeddedPicture:
    """Write a figure into a file, and give it as it stands in the page."""
    save(figure, path)
    width = f"{CSS_DOTS_PER_INCH * figure.get_figwidth():.0f}"
    return EmbeddedPicture(b64encode(path.read_bytes()).decode(), width)


def _embed_motion(
    folder: Path, report: LoopReport, markers: Sequence[MovingMarkers]
) -> tuple[EmbeddedPicture | None, EmbeddedPicture | None]:
    """The moving picture and the charts of markers, written and as they stand in the page; None without markers."""
    film, charts = motion_film(report, markers), marker_charts(report, markers)
    if film is None or charts is None:
        return None, None
    whole_file(folder / FILM_FILE, film)
    moving = EmbeddedPicture(b64encode(film).decode(), f"{CSS_DOTS_PER_INCH * FILM_WIDTH_IN:.0f}", "gif")
    return moving, _embedded(folder / MARKERS_FILE, charts)
