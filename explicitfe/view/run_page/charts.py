"""The charts of a run: its muscles, named points, contact and energies over time, or force over displacement of a tool."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from explicitfe.measure.sections import X, Y, Z
from explicitfe.results import Result
from explicitfe.results.run_summary import kind_of
from explicitfe.view.hourglass import hourglass_share
from explicitfe.view.muscles import activation, muscle_name, muscles_of, on_times
from explicitfe.view.over_time import ADVISED_HOURGLASS_SHARE, SIDEWAYS_SHARE
from explicitfe.view.page.chart import COLOUR_COUNT, Chart, Line, chart

TIME_LABEL = "time (ms)"
ENERGY_LINES = {
    "external_work": "external work",
    "internal_energy": "elastic",
    "hourglass_energy": "hourglass",
    "kinetic_energy": "kinetic",
    "damping_loss": "lost to damping",
}
# Black is the last colour; the work from outside stands apart from where it goes.
COLOUR_OF_WORK = COLOUR_COUNT - 1


@dataclass(frozen=True, eq=False)
class PlannedChart:
    """What a chart is to show, before its axes are those of the same chart of other results."""

    title: str
    y_label: str
    series: list[Line]
    x_label: str
    follows: str
    spans: list[tuple[float, float]]
    logarithmic: bool = False


def charts_of(results: Sequence[Result]) -> list[list[Chart]]:
    """The charts of each result, those left out for which it has nothing to show; the same charts have the same axes."""
    plans = [_plans(result) for result in results]
    return [[drawn for plan in own if (drawn := _draw(plan, _alike(plan, plans))) is not None] for own in plans]


def _alike(plan: PlannedChart, plans: Sequence[Sequence[PlannedChart]]) -> list[Line]:
    """The series of all charts of this name."""
    return [series for own in plans for other in own if other.title == plan.title for series in other.series]


def _draw(plan: PlannedChart, alike: Sequence[Line]) -> Chart | None:
    x, y = np.concatenate([one.x for one in alike]), np.concatenate([one.y for one in alike])
    kept = np.isfinite(x) & np.isfinite(y) & ((y > 0.0) | (not plan.logarithmic))
    if not kept.any():
        return None
    return chart(
        plan.title,
        plan.series,
        x_label=plan.x_label,
        y_label=plan.y_label,
        x_range=(float(x[kept].min()), float(x[kept].max())),
        y_range=(float(y[kept].min()), float(y[kept].max())),
        logarithmic=plan.logarithmic,
        spans=plan.spans,
        follows=plan.follows,
    )


def _plans(result: Result) -> list[PlannedChart]:
    if len(result.history("time")) < 2:
        return []
    return _tool_charts(result) if kind_of(result.model) == "relaxation" else _time_charts(result)


def _time_charts(result: Result) -> list[PlannedChart]:
    times = 1e3 * result.history("time")
    muscles = [muscle for muscle in muscles_of(result) if muscle["force_N"] > 0.0]
    spans = on_times(muscles, times[-1])
    plans = []

    def add(title: str, y_label: str, series: list[Line], logarithmic: bool = False) -> None:
        if series:
            plans.append(PlannedChart(title, y_label, series, TIME_LABEL, "time", spans, logarithmic))

    courses = [(muscle, *activation(muscle, times[-1])) for muscle in muscles]
    add("Force of the muscles", "N", [Line(muscle_name(one), at, one["force_N"] * share) for one, at, share in courses])
    for title, unit, lines in [*_point_lines(result), *_contact_lines(result)]:
        add(title, unit, _lines(times, lines))
    if {*ENERGY_LINES, "balance_error"} <= set(result.history_names):
        energies = {label: result.history(name) for name, label in ENERGY_LINES.items()}
        largest = max(float(np.nanmax(np.abs(energy), initial=0.0)) for energy in energies.values())
        factor, unit = next(((f, u) for f, u in ((1.0, "J"), (1e3, "mJ"), (1e6, "µJ")) if f * largest >= 0.1), (1e9, "nJ"))
        colours = [COLOUR_OF_WORK, *range(len(energies))]
        add(
            "Energies",
            unit,
            [Line(label, times, factor * y, colour=c) for (label, y), c in zip(energies.items(), colours, strict=False)],
        )
        error = 100.0 * result.history("balance_error")
        add("Error of the energy balance, largest so far", "%", [Line("", times, error, colour=COLOUR_OF_WORK)], True)
        advised = np.full(len(times), 100.0 * ADVISED_HOURGLASS_SHARE)
        share = [Line("", times, 100.0 * hourglass_share(result), colour=1), Line("", times, advised, colour=6, dash=1)]
        add(f"Hourglass share of the elastic energy (dashed: {100.0 * ADVISED_HOURGLASS_SHARE:g} % is advised)", "%", share)
    return plans


def _lines(times: np.ndarray, lines: dict[str, np.ndarray]) -> list[Line]:
    return [Line(name, times, y, dash=number // COLOUR_COUNT) for number, (name, y) in enumerate(lines.items())]


def _point_lines(result: Result) -> list[tuple[str, str, dict[str, np.ndarray]]]:
    """Of the named points: title, unit, and lines by name, from front to back as the model names them."""
    stored = [name.removeprefix("probe_").removesuffix("_displacement") for name in result.history_names]
    probes = [name for name in stored if f"probe_{name}_displacement" in result.history_names]
    if not probes:
        return []
    order = list(result.model.get("probes", result.mesh.named_points))
    probes.sort(key=lambda name: order.index(name) if name in order else len(order))
    moved = {name: 1e3 * result.history(f"probe_{name}_displacement") for name in probes}
    charts = [
        ("Named points: forward", "mm", {name: -u[:, X] for name, u in moved.items()}),
        ("Named points: up", "mm", {name: u[:, Z] for name, u in moved.items()}),
    ]
    largest = max(float(np.nanmax(np.abs(u), initial=0.0)) for u in moved.values())
    if max(float(np.nanmax(np.abs(u[:, Y]), initial=0.0)) for u in moved.values()) > SIDEWAYS_SHARE * largest:
        charts.append(("Named points: to the right", "mm", {name: u[:, Y] for name, u in moved.items()}))
    with_speed = [name for name in probes if f"probe_{name}_velocity" in result.history_names]
    speeds = {name: 1e3 * np.linalg.norm(result.history(f"probe_{name}_velocity"), axis=1) for name in with_speed}
    return [*charts, ("Named points: speed", "mm/s", speeds)]


def _contact_lines(result: Result) -> list[tuple[str, str, dict[str, np.ndarray]]]:
    """Of the bones that were touched: title, unit, and lines by the bones' names."""
    charts = []
    for title, unit, factor, kind in (("Contact force", "N", 1.0, "force"), ("Contact area", "mm²", 1e6, "area")):
        lines = {}
        for bone in result.bones:
            name = f"contact_{bone}_{kind}"
            if name in result.history_names:
                values = result.history(name)
                lines[bone] = factor * (values if values.ndim == 1 else np.linalg.norm(values, axis=1))
        if any(np.any(line) for line in lines.values()):
            charts.append((title, unit, lines))
    return charts


def _tool_charts(result: Result) -> list[PlannedChart]:
    displacement, force = 1e3 * result.history("indentation"), result.history("force")
    series = [Line("force", displacement, force), Line("", displacement, force, drawn="dots", colour=0)]
    label = "displacement of the tool since first touch (mm)"
    return [PlannedChart("Force of the whole tool", "N", series, label, "indentation", [])]
