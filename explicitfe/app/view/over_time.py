"""Pictures of a run over time: its named points, and its energies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from explicitfe.app.view.energy_balance import energy_balance
from explicitfe.app.view.heading import result_figure
from explicitfe.app.view.hourglass import hourglass_share
from explicitfe.app.view.muscles import activation, muscle_name, muscles_of, on_times
from explicitfe.app.view.palette import COLOURS, LINE_STYLES, plain
from explicitfe.results.files import Result
from explicitfe.results.measure.reactions import force_curve
from explicitfe.results.measure.sections import X, Y, Z

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Users of explicit codes are advised to keep the hourglass energy below this share of the elastic energy.
ADVISED_HOURGLASS_SHARE = 0.1
# A lateral movement below this share of the largest one gets a line of text instead of a panel.
SIDEWAYS_SHARE = 1e-3
# Opacity of stored and of dissipated energies in a stack.
STORED_OPACITY, LOST_OPACITY = 0.8, 0.3
# Names of lines stand this far apart, which keeps them readable.
LINE_OF_TEXT_IN = 0.19


def probes_figure(result: Result, step: int) -> Figure | None:
    """Displacement and speed of the probes over time; None where there is nothing to show."""
    names = [name.removesuffix("_displacement") for name in result.history_names if name.endswith("_displacement")]
    probes = [name.removeprefix("probe_") for name in names if name.startswith("probe_")]
    times = 1e3 * result.history("time")
    if not probes or len(times) < 2:
        return None
    # In the order of the model, from front to back; the file sorts them by name.
    order = list(result.model.get("probes", result.mesh.named_points))
    probes.sort(key=lambda name: order.index(name) if name in order else len(order))
    moved = {name: 1e3 * result.history(f"probe_{name}_displacement") for name in probes}
    largest = max(np.nanmax(np.abs(u), initial=0.0) for u in moved.values())
    rows = [
        ("forward (mm)", {name: -u[:, X] for name, u in moved.items()}),
        ("up (mm)", {name: u[:, Z] for name, u in moved.items()}),
    ]
    lateral = max(np.nanmax(np.abs(u[:, Y]), initial=0.0) for u in moved.values())
    if lateral > SIDEWAYS_SHARE * largest:
        rows.append(("to the right (mm)", {name: u[:, Y] for name, u in moved.items()}))
    velocity = {name: f"probe_{name}_velocity" for name in probes if f"probe_{name}_velocity" in result.history_names}
    if velocity:
        speeds = {name: 1e3 * np.linalg.norm(result.history(key), axis=1) for name, key in velocity.items()}
        rows.append(("speed (mm/s)", speeds))

    figure = result_figure(result, 1.3 + 0.22 * len(muscles_of(result)) + 2.2 * len(rows), "Named points over time")
    panels = _time_panels(figure, result, [[label] for label, _ in rows], times[-1])
    for axes, (label, lines) in zip(panels, rows, strict=True):
        axes.set_ylabel(label)
        axes.axhline(0.0, color="0.6", lw=0.8)
        ends = {}
        for k, name in enumerate(lines):
            colour, line = COLOURS[k % len(COLOURS)], LINE_STYLES[k // len(COLOURS) % len(LINE_STYLES)]
            axes.plot(times, lines[name], lw=1.6, color=colour, ls=line)
            shown = np.flatnonzero(np.isfinite(lines[name]))
            ends[name] = (float(lines[name][shown[-1]]) if len(shown) else 0.0, colour)
        _label_ends(figure, axes, ends)
    if lateral <= SIDEWAYS_SHARE * largest:
        panels[0].set_title(f"to the right: at most {max(1e-3, lateral):.2g} mm", fontsize=9, color="0.35", loc="right", pad=3)
    for axes in panels[:-1]:
        axes.tick_params(labelbottom=False)
    panels[-1].set_xlabel("time (ms)")
    figure.align_ylabels(panels)
    return figure


def reaction_figure(result: Result, name: str) -> Figure:
    """Force of a support, a fixed or prescribed node set or a bone over displacement; over time where nothing moves.

    Raises
    ------
    InputError : the result has no such force.
    """
    curve = force_curve(result, name)
    along = "" if curve.moved is None else f", along the displacement of {curve.moved}"
    what = f"Force of {name} on the body" if curve.own else f"Force of the body on {name}"
    figure = result_figure(result, 4.2, what + along)
    axes = figure.add_subplot()
    plain(axes)
    x = 1e3 * (result.history("time") if curve.moved is None else curve.displacement_m)
    axes.plot(x, curve.force_N, lw=1.6, color=COLOURS[0], marker=".", ms=4)
    axes.axhline(0.0, color="0.6", lw=0.8)
    axes.set_xlabel("time (ms)" if curve.moved is None else f"displacement of {curve.moved} (mm)")
    axes.set_ylabel("force (N)")
    return figure


def energies_figure(result: Result, step: int) -> Figure | None:
    """Stacked energies over time, the error of their balance and the hourglass share; None where there is nothing to show."""
    from matplotlib.colors import to_rgba
    from matplotlib.ticker import LogFormatter

    balance = energy_balance(result)
    if balance is None or not {"internal_energy", "hourglass_energy"} <= set(result.history_names):
        return None
    times, (factor, unit) = 1e3 * balance.time, balance.unit()
    muscles = muscles_of(result)
    figure = result_figure(result, 7.4 + 0.22 * len(muscles), "Energy balance over time")
    panels = _time_panels(figure, result, [["energy", "energy"], ["balance", "share"]], times[-1], [1.9, 1.0])
    edges = factor * balance.edges()
    for (term, _), low, high in zip(balance.terms, edges[:-1], edges[1:], strict=True):
        colour = to_rgba(COLOURS[term.colour], LOST_OPACITY if term.is_loss else STORED_OPACITY)
        panels[0].fill_between(times, low, high, color=colour, lw=0, label=term.label)
    panels[0].plot(times, factor * balance.work, color="black", lw=1.8, label=balance.work_label)
    panels[0].set_title("stored (dark) and dissipated (pale) energies add up to the external work (line)", fontsize=10)
    panels[0].set_ylabel(f"energy ({unit})")
    handles, labels = panels[0].get_legend_handles_labels()
    # From the top of the stack downwards, as the areas are drawn.
    panels[0].legend(handles[::-1], labels[::-1], loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)

    error = 100.0 * result.history("balance_error")
    if np.any(error > 0.0):
        panels[1].plot(times, np.where(error > 0.0, error, np.nan), color="black", lw=1.6)
        panels[1].set_yscale("log")
        panels[1].yaxis.set_major_formatter(LogFormatter())  # the usual one writes formulas
        panels[1].yaxis.set_minor_formatter(LogFormatter())
    panels[1].set_title("largest error of the energy balance so far", fontsize=10)
    panels[1].set_ylabel("relative error (%)")
    share = hourglass_share(result)
    panels[2].axhline(100.0 * ADVISED_HOURGLASS_SHARE, color="0.4", lw=1.0, ls="--")
    panels[2].plot(times, 100.0 * share, color=COLOURS[1], lw=1.6)
    panels[2].set_title(
        f"hourglass share of the elastic energy (dashed: limit, {100.0 * ADVISED_HOURGLASS_SHARE:g} %)", fontsize=10
    )
    panels[2].set_ylabel("share (%)")
    panels[2].set_ylim(0.0, max(12.5, 110.0 * np.nanmax(share, initial=0.0)))
    for axes in panels[1:]:
        axes.set_xlabel("time (ms)")
    return figure


def _time_panels(
    figure: Figure, result: Result, rows: list[list[str]], end_ms: float, heights: Sequence[float] | None = None
) -> list[Axes]:
    """Panels over time with the muscles' pulls above them.

    Parameters
    ----------
    rows : the panels of each row, by name.
    heights : of the rows, as shares; all the same if left out.

    Returns
    -------
    The panels in the order of ``rows``.
    """
    muscles = [muscle for muscle in muscles_of(result) if muscle["force_N"] > 0.0]
    heights = list(heights or [1.0] * len(rows))
    total = figure.get_figheight()
    if muscles:
        share = 0.24 * len(muscles) / (total - 1.5 - 0.24 * len(muscles))
        rows = [["muscles"] * len(rows[0]), *rows]
        heights = [share * sum(heights), *heights]
    panels: dict[str, Axes] = figure.subplot_mosaic([list(row) for row in rows], height_ratios=heights)
    if muscles:
        strip = panels.pop("muscles")
        for k, muscle in enumerate(muscles):
            times, scales = activation(muscle, end_ms)
            strip.fill_between(times, -k, -k + 0.8 * scales / max(1.0, scales.max()), color="0.45", lw=0)
        strip.set_yticks([0.4 - k for k in range(len(muscles))], [muscle_name(muscle) for muscle in muscles])
        strip.set_ylim(0.9 - len(muscles), 1.0)
        strip.set_xlim(0.0, end_ms)
        strip.spines[["top", "right", "left"]].set_visible(False)
        strip.tick_params(labelbottom=False, left=False)
    for axes in panels.values():
        plain(axes)
        axes.set_xlim(0.0, end_ms)
        for start, end in on_times(muscles, end_ms):
            axes.axvspan(start, end, color="0.955", lw=0, zorder=-1)
    return list(panels.values())


def _label_ends(figure: Figure, axes: Axes, ends: Mapping[str, tuple[float, str]]) -> None:
    """Write names at the ends of lines, in their colours, pushed apart where they would lie on each other.

    ``ends`` is name -> value at the end of the line, and colour.
    """
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom, top)
    height = figure.get_figheight() / (len(figure.axes) + 0.5)
    gap = min(LINE_OF_TEXT_IN / height, 1.0 / max(1, len(ends)))
    names = sorted(ends, key=lambda name: ends[name][0])
    wanted = np.array([(ends[name][0] - bottom) / (top - bottom) for name in names])
    for name, place in zip(names, spread(wanted, gap), strict=True):
        axes.annotate(
            name,
            (1.0, (ends[name][0] - bottom) / (top - bottom)),
            (1.035, place),
            xycoords="axes fraction",
            textcoords="axes fraction",
            color=ends[name][1],
            va="center",
            arrowprops={
                "arrowstyle": "-",
                "color": ends[name][1],
                "lw": 0.8,
                "relpos": (0.0, 0.5),
                "shrinkA": 0,
                "shrinkB": 0,
            },
        )


def spread(wanted: np.ndarray, gap: float) -> np.ndarray:
    """Places in [0, 1] near the sorted ``wanted`` ones and at least ``gap`` apart, if there is room for that."""
    # These are the least squares with a given order. Without the gaps this is isotonic regression: pool adjacent violators.
    offset = gap * np.arange(len(wanted))
    blocks: list[tuple[float, int]] = []  # mean and size
    for value in wanted - offset:
        blocks.append((float(value), 1))
        while len(blocks) > 1 and blocks[-2][0] >= blocks[-1][0]:
            mean, size = blocks.pop()
            blocks[-1] = ((blocks[-1][0] * blocks[-1][1] + mean * size) / (blocks[-1][1] + size), blocks[-1][1] + size)
    flat = np.repeat([mean for mean, _ in blocks], [size for _, size in blocks])
    return np.clip(flat, 0.0, max(0.0, 1.0 - gap * (len(wanted) - 1))) + offset
