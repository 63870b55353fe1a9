"""The report of a closed loop: one page that a person understands in a minute, with its pictures as files next to it.

Any key of the report may be missing, any number not finite: then a dash stands on the page, or nothing. The page holds its
charts and its style sheet and runs nothing, so that it is whole without a network and in an e-mail.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from explicitfe.app.view.page.chart import Chart
from explicitfe.app.view.page.close_loop import parts
from explicitfe.app.view.page.close_loop.motion_charts import marker_charts
from explicitfe.app.view.page.close_loop.motion_film import motion_film
from explicitfe.app.view.page.close_loop.motion_tables import error_table, feature_table, repeats_note
from explicitfe.app.view.page.close_loop.pictures import (
    CauseBar,
    cause_bars,
    causes_figure,
    curve_charts,
    decisive_limits,
    figure_of,
    residual_charts,
    sensitivity_charts,
)
from explicitfe.app.view.page.close_loop.reading import drawn_curves, has_changed
from explicitfe.app.view.page.frame import page_text
from explicitfe.app.view.page.tables import table
from explicitfe.app.view.page.words import smooth_part
from explicitfe.app.view.palette import save
from explicitfe.results.documents.loop_report import LoopReport, ReportCurve
from explicitfe.results.documents.motion_report import MovingMarkers
from explicitfe.results.files.folder import whole_file

PAGE_FILE = "report.html"
FILM_FILE, MARKERS_FILE = "motion.gif", "markers.png"


@dataclass(frozen=True)
class LoopCharts:
    """The charts of the page; empty lists where there is nothing to show."""

    causes: list[CauseBar]
    curves: list[Chart]
    residuals: list[Chart]
    sensitivity: list[Chart | None]
    markers: list[list[Chart | None]]


def loop_charts(report: LoopReport, curves: Sequence[ReportCurve], markers: Sequence[MovingMarkers] = ()) -> LoopCharts:
    """The charts of a report."""
    return LoopCharts(
        cause_bars(report),
        curve_charts(report, curves),
        residual_charts(report, curves),
        sensitivity_charts(report),
        marker_charts(report, markers),
    )


def write(folder: Path, report: LoopReport, curves: Sequence[ReportCurve], markers: Sequence[MovingMarkers] = ()) -> list[str]:
    """Write the page and its pictures into ``folder``, and return the names of the files."""
    drawn = drawn_curves(curves)
    charts, film = loop_charts(report, drawn, markers), motion_film(report, markers)
    (folder / PAGE_FILE).write_text(html(report, drawn, charts, film), encoding="utf-8")
    figures = {
        "causes.png": causes_figure(report),
        "before-after.png": figure_of(charts.curves, 2),
        "residuals.png": figure_of(charts.residuals, min(4, max(len(charts.residuals), 1))),
    }
    if charts.sensitivity:
        figures["sensitivity.png"] = figure_of(charts.sensitivity, 4)
    if film is not None:
        whole_file(folder / FILM_FILE, film)
        rows = charts.markers
        figures[MARKERS_FILE] = figure_of([one for row in rows for one in row], len(rows[0]))
    for name, figure in figures.items():
        save(figure, folder / name)
    pictures = [name for name in figures if name != MARKERS_FILE]
    return [PAGE_FILE, *pictures, *([FILM_FILE, MARKERS_FILE] if film is not None else [])]


def html(report: LoopReport, curves: Sequence[ReportCurve], charts: LoopCharts, film: bytes | None = None) -> str:
    """The text of the page, from ``page.html.j2`` and ``style.css`` beside this file; ``film`` is a GIF."""
    first = parts.first_screen(report)
    return page_text(
        "page/close_loop/page.html.j2",
        styles=["page/close_loop/style.css"],
        title=f"{report.dataset or report.title or 'closed loop'}: {first.headline}",
        charts=charts,
        decisive=decisive_limits(report),
        film=None if film is None else b64encode(film).decode(),
        first=first,
        residual_caption=parts.residual_caption(curves),
        smooth_part=smooth_part(report),
        is_changed=has_changed(report),
        causes=parts.causes(report),
        not_testable=parts.not_testable(report),
        hypotheses=parts.hypotheses(report),
        next_tests=parts.next_tests(report),
        errors=parts.curve_errors(report),
        constants=parts.constants(report),
        motion_errors=error_table(report),
        features=feature_table(report),
        repeats_note=repeats_note(report),
        noise=parts.noise(report),
        numerical=parts.numerical(report),
        scatter=parts.scatter(report),
        assumed=parts.assumed(report),
        left_out=table(("curve", "why"), report.split.left_out.items(), "tw"),
        report=report,
        warnings=[text for text in report.warnings if text],
        provenance=parts.provenance(report),
    )
