"""Charts of a run: muscles, named points, contact and energies over time, or force over displacement of a tool."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import zip_longest
from typing import NamedTuple

import numpy as np

from explicitfe.app.view.energy_balance import energy_balance
from explicitfe.app.view.hourglass import hourglass_share
from explicitfe.app.view.mouth import is_mouth
from explicitfe.app.view.muscles import activation, muscle_name, muscles_of, on_times
from explicitfe.app.view.page.chart import COLOUR_COUNT, Chart, Line, chart
from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.files import Result
from explicitfe.results.measure.document import Measures
from explicitfe.results.measure.sections import X, Y, Z
from explicitfe.results.measure.tract import TOUCHING_GAP_M

TIME_LABEL, TOOL_LABEL = "time (ms)", "displacement of the tool after first contact (mm)"
FORCES_TITLE, POINTS_TITLE = "Muscle forces", "Named points: "
# Users of explicit codes are advised to keep the hourglass energy below this share of the elastic energy.
ADVISED_HOURGLASS_SHARE = 0.1
# A lateral movement below this share of the largest one gets no chart.
SIDEWAYS_SHARE = 1e-3
# Black is the last colour: the external work is drawn over the energies that add up to it, and a limit over what it limits.
COLOUR_OF_WORK = COLOUR_COUNT - 1
BALANCE_TITLE = "Energy balance: stored (dark) and dissipated (pale) energies add up to the external work (line)"


class PlannedChart(NamedTuple):
    """A chart that shares its axes with the same chart of other results: ``draw`` makes it when it is given their series."""

    title: str
    series: list[Line]
    draw: Callable[..., Chart | None]
    numerical: bool = False


def charts_of(results: Sequence[Result], measured: Sequence[Measures | None] = ()) -> list[list[Chart]]:
    """The charts of each result, without those for which it has no data; charts of the same title have the same axes.

    ``measured`` are measures of each at its last step, which have the leak over time.
    """
    plans = [_plans(result, measures) for result, measures in zip_longest(results, measured)]
    alike: dict[str, list[Line]] = {}
    for plan in (plan for own in plans for plan in own):
        alike.setdefault(plan.title, []).extend(plan.series)
    charts = []
    for result, own in zip(results, plans, strict=True):
        follows = "indentation" if kind_of(result.model) == "relaxation" else "time"
        shown = [(plan, plan.draw(plan.title, plan.series, alike=alike[plan.title])) for plan in own]
        charts.append([replace(one, follows=follows, numerical=plan.numerical) for plan, one in shown if one is not None])
    return charts


def _plans(result: Result, measures: Measures | None) -> list[PlannedChart]:
    if len(result.history("time")) < 2:
        return []
    return _tool_charts(result) if kind_of(result.model) == "relaxation" else _time_charts(result, measures)


def _time_charts(result: Result, measures: Measures | None) -> list[PlannedChart]:
    times = 1e3 * result.history("time")
    muscles = [muscle for muscle in muscles_of(result) if muscle["force_N"] > 0.0]
    spans = on_times(muscles, times[-1])
    plans = []

    def add(title: str, y_label: str, series: list[Line], logarithmic: bool = False, numerical: bool = False) -> None:
        if series:
            draw = partial(chart, x_label=TIME_LABEL, y_label=y_label, spans=spans, logarithmic=logarithmic)
            plans.append(PlannedChart(title, series, draw, numerical))

    add(f"Leak: widest open way (dashed: closed below {1e3 * TOUCHING_GAP_M:g} mm)", "mm", _leak_lines(result, measures))
    courses = [(muscle, *activation(muscle, times[-1])) for muscle in muscles]
    add(FORCES_TITLE, "N", [Line(muscle_name(one), at, one["force_N"] * share) for one, at, share in courses])
    for title, unit, lines in [*_point_lines(result), *_contact_lines(result)]:
        add(title, unit, _lines(times, lines))
    if stack := energy_lines(result):
        add(BALANCE_TITLE, stack[1], stack[0], numerical=True)
        error = 100.0 * result.history("balance_error")
        add("Largest error of the energy balance so far", "%", [Line("", times, error, colour=COLOUR_OF_WORK)], True, True)
        if {"internal_energy", "hourglass_energy"} <= set(result.history_names):
            limit = np.full(len(times), 100.0 * ADVISED_HOURGLASS_SHARE)
            share = [Line("", times, 100.0 * hourglass_share(result), colour=1), Line("", times, limit, colour=6, dash=1)]
            title = f"Hourglass energy as a share of the elastic energy (dashed: recommended limit, {limit[0]:g} %)"
            add(title, "%", share, numerical=True)
    return plans


def energy_lines(result: Result) -> tuple[list[Line], str] | None:
    """The stacked terms of the energy balance as bands and the external work as a line, in a unit; None where there are none."""
    balance = energy_balance(result)
    if balance is None:
        return None
    factor, unit = balance.unit()
    times, edges = 1e3 * balance.time, factor * balance.edges()
    bands = [
        Line(term.label, times, low, "band" if term.is_loss else "dark-band", colour=term.colour, y_high=high)
        for (term, _), low, high in zip(balance.terms, edges[:-1], edges[1:], strict=True)
    ]
    return [*bands, Line(balance.work_label, times, factor * balance.work, colour=COLOUR_OF_WORK)], unit


def _lines(times: np.ndarray, lines: dict[str, np.ndarray]) -> list[Line]:
    return [Line(name, times, y, dash=number // COLOUR_COUNT) for number, (name, y) in enumerate(lines.items())]


def _point_lines(result: Result) -> list[tuple[str, str, dict[str, np.ndarray]]]:
    """Title, unit and lines by name of the charts of the named points, in the order of the model."""
    stored = [name.removeprefix("probe_").removesuffix("_displacement") for name in result.history_names]
    probes = [name for name in stored if f"probe_{name}_displacement" in result.history_names]
    if not probes:
        return []
    order = list(result.model.get("probes", result.mesh.named_points))
    probes.sort(key=lambda name: order.index(name) if name in order else len(order))
    moved = {name: 1e3 * result.history(f"probe_{name}_displacement") for name in probes}
    charts = [
        (f"{POINTS_TITLE}forward", "mm", {name: -u[:, X] for name, u in moved.items()}),
        (f"{POINTS_TITLE}up", "mm", {name: u[:, Z] for name, u in moved.items()}),
    ]
    largest = max(float(np.nanmax(np.abs(u), initial=0.0)) for u in moved.values())
    if max(float(np.nanmax(np.abs(u[:, Y]), initial=0.0)) for u in moved.values()) > SIDEWAYS_SHARE * largest:
        charts.append((f"{POINTS_TITLE}to the right", "mm", {name: u[:, Y] for name, u in moved.items()}))
    with_speed = [name for name in probes if f"probe_{name}_velocity" in result.history_names]
    speeds = {name: 1e3 * np.linalg.norm(result.history(f"probe_{name}_velocity"), axis=1) for name in with_speed}
    return [*charts, (f"{POINTS_TITLE}speed", "mm/s", speeds)]


def _contact_lines(result: Result) -> list[tuple[str, str, dict[str, np.ndarray]]]:
    """Title, unit and lines by name of the charts of reaction forces, and of contact of bones that were touched."""
    held = {
        name: np.linalg.norm(result.history(f"reaction_{name}_force"), axis=1)
        for name in result.reaction_names
        if f"reaction_{name}_force" in result.history_names
    }
    charts = [("Reaction forces", "N", held)] if any(np.any(line) for line in held.values()) else []
    for title, unit, factor, kind in (("Resultant contact force", "N", 1.0, "force"), ("Contact area", "mm²", 1e6, "area")):
        lines = {}
        for bone in result.bones:
            name = f"contact_{bone}_{kind}"
            if name in result.history_names:
                values = result.history(name)
                lines[bone] = factor * (values if values.ndim == 1 else np.linalg.norm(values, axis=1))
        if any(np.any(line) for line in lines.values()):
            charts.append((title, unit, lines))
    return charts


def _leak_lines(result: Result, measures: Measures | None) -> list[Line]:
    """The width of the leak of a tongue in its mouth, and the width below which it counts as closed."""
    if measures is None or measures.leak is None or not is_mouth(result):
        return []
    times, width = np.array(measures.leak.course.time_ms), np.array(measures.leak.course.width_mm)
    limit = Line("", times, np.full(len(times), 1e3 * TOUCHING_GAP_M), colour=COLOUR_OF_WORK, dash=1)
    return [Line("width", times, width), limit]


def _tool_charts(result: Result) -> list[PlannedChart]:
    draw = partial(chart, x_label=TOOL_LABEL, y_label="N")
    return [PlannedChart("Tool force (whole tool)", tool_lines(result), draw)]


def tool_lines(result: Result) -> list[Line]:
    """Force (N) over displacement (mm) of the tool of an indentation: loading, and unloading dashed."""
    displacement, force = 1e3 * result.history("indentation"), result.history("force")
    back = np.flatnonzero(np.diff(displacement) < 0.0)
    turn = int(back[0]) if len(back) else len(displacement) - 1
    parts = (("loading" if len(back) else "force", slice(turn + 1), 0), ("unloading", slice(turn, None), 1))
    lines = [
        Line(name, displacement[part], force[part], dash=dash, colour=dash) for name, part, dash in parts[: 1 + len(back[:1])]
    ]
    return [one for line in lines for one in (line, replace(line, name="", drawn="dots", dash=0))]
