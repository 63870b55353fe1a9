"""Page of an identification: constants with their intervals, comparison of laws, curves, sensitivity to the assumptions."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, cast

import numpy as np

from explicitfe.app.view.page.chart import COLOUR_COUNT, Chart, Line, chart
from explicitfe.app.view.page.curves import curve_chart, worst_charts
from explicitfe.app.view.page.frame import page_text
from explicitfe.app.view.page.tables import PageTable, bars, table
from explicitfe.app.view.page.words import finite, number, percent, plural
from explicitfe.results.documents.fitted_curves import ConstantProfile, FittedCurve
from explicitfe.results.documents.identification import Identification, IdentifiedGroup

# A constant with this rise of chi squared stands at an end of its 95 % interval: the quantile of one degree of freedom.
CHI2_RISE_95_PERCENT = 3.84
HIGHEST_RISE = 10.0  # that is shown
SIDES_OF_A_FIT = {"holdout": "held out", "fit": "fitted"}


def constant_name(key: str) -> str:
    """Name of a constant without its unit."""
    return key.removesuffix("_Pa")


def unit_of_constant(key: str) -> str:
    """ " Pa", or nothing for a constant without a unit."""
    return " Pa" if key.endswith("_Pa") else ""


def identify_page(
    identification: Identification,
    curves: Mapping[str, Sequence[FittedCurve]],
    profiles: Mapping[str, Sequence[ConstantProfile]],
) -> str:
    """The text of the page; ``curves`` and ``profiles`` are those of each group that has constants."""
    groups = [
        _group(name, group, curves.get(name, ()), profiles.get(name, ())) for name, group in identification["groups"].items()
    ]
    how = {"refinement": number(identification["refinement"]), "Poisson's ratio": f"{identification['poisson']:g}"}
    how |= {"simulations": str(identification["forward_runs"]), "computed in": f"{number(identification['wall_s'], 2)} s"}
    method = "" if identification["method"] == "least-squares" else f" --method {identification['method']}"
    method += "" if identification["law"] == "yeoh" else f" --law {identification['law']}"
    title = identification["title"] or identification["dataset"]
    headline = next(iter(identification["groups"].values())).get("headline", "") if len(groups) == 1 else ""
    conclusion, _, reasons = headline.partition(". ")
    return page_text(
        "page/identify.html.j2",
        title=conclusion.rstrip(".") or title,
        reasons=reasons,
        dataset=f"{title} ({identification['dataset']})" if conclusion else identification["dataset"],
        method=identification["method"].replace("-", " "),
        groups=groups,
        left_out=table(("curve", "why"), list(identification["left_out"].items()), "tw"),
        warnings=identification["warnings"],
        command=f"explicitfe identify {shlex.quote(identification['path'])}{method}",
        how=table(("", ""), list(how.items()), "tt"),
    )


def _group(
    name: str, group: IdentifiedGroup, curves: Sequence[FittedCurve], profiles: Sequence[ConstantProfile]
) -> dict[str, object]:
    """Curves that share their constants, as the page shows them; ``message`` is the reason if there are none."""
    widened_by = group.get("widened_by", 1.0)
    widened = f"The intervals are {number(widened_by, 2)} times wider than from independent noise alone."
    return {
        "name": name,
        "message": group.get("message", "") if "constants" not in group else "",
        "headline": group.get("headline", ""),
        "constants": _constants(group),
        "widened": widened if widened_by > 1.0 else "",
        "law": group.get("law", ""),
        "laws": laws_table(group),
        "charts": worst_charts([_drawn(curve) for curve in curves]),
        "profiles": [drawn for profile in profiles if (drawn := profile_chart(profile)) is not None],
        "curves": curves_table(group),
        "hides": hides_table(group),
        "facts": dict(facts_of(group)),
        "warnings": group.get("warnings", []),
    }


def _constants(group: IdentifiedGroup) -> PageTable | None:
    rows = []
    for name, entry in group.get("constants", {}).items():
        intervals = [_interval(entry.get("total95")), _interval(entry.get("ci95"))]
        at_bound = "at its bound" if name in group.get("at_bound", []) else ""
        rows.append((constant_name(name), f"{number(entry['value'], 4)}{unit_of_constant(name)}", *intervals, at_bound))
    moduli = (("shear modulus", group.get("shear_modulus")), ("Young's modulus", group.get("youngs_modulus")))
    for name, modulus in moduli:
        if modulus is not None:
            intervals = [_interval(modulus.get("total95")), _interval(modulus.get("ci95"))]
            rows.append((f"{name}, small strain", f"{number(modulus['value'], 4)} Pa", *intervals, ""))
    return table(("constant", "value", "95 % with what was assumed", "95 % from the data", ""), rows, "tnnnt")


def _interval(ends: Sequence[float | None] | None) -> str:
    low, high = ends or (None, None)
    return f"{number(low)} to {number(high) if finite(high) else 'no limit'}" if finite(low) else ""


def laws_table(group: IdentifiedGroup) -> PageTable | None:
    """The laws that were compared; None for a single law."""
    rows: list[tuple[Any, ...]] = []
    shown = group.get("laws", [])
    for row in shown if len(shown) > 1 else []:
        if "problem" in row:
            rows.append((row["law"], row["problem"], "", "", "", ""))
            continue
        held_out = row["held_out_nrmse"]
        differences = (number(row[key], 3) if finite(row[key]) else "" for key in ("aicc_difference", "bic_difference"))
        modulus = f"{number(row['shear_modulus_Pa'], 4)} Pa"
        rows.append((row["law"], modulus, _share(row["nrmse"]), _share(held_out) if finite(held_out) else "", *differences))
    return table(("law", "shear modulus", "misfit", "held-out error", "ΔAICc", "ΔBIC"), rows, "tnnnnn")


def _drawn(curve: FittedCurve) -> tuple[float, Chart | None]:
    """The error of a curve, and its chart."""
    largest = float(np.abs(curve["measured"]).max(initial=0.0))
    rmse = float(np.sqrt(np.mean((curve["predicted"] - curve["measured"]) ** 2)))
    error = rmse / largest if largest > 0.0 else float("nan")
    parts = [curve["id"], SIDES_OF_A_FIT[curve["split"]], f"error {percent(error)}" if finite(error) else ""]
    title, axes = ", ".join(filter(None, parts)), (curve["x_label"], curve["y_label"])
    model = (curve["line_x"], curve["line_y"])
    return error if finite(error) else 0.0, curve_chart(title, axes, curve["x"], curve["measured"], curve["sd"], model)


def profile_chart(profile: ConstantProfile) -> Chart | None:
    """Profile likelihood of a constant, the parabola of the curvature, and the intervals, that of independent noise pale."""
    values, name, unit = profile["values"], constant_name(profile["name"]), unit_of_constant(profile["name"])
    best, sd, wider = profile["best"], profile["sd"], profile["widened_by"]
    ends, (low, high) = np.array([values[0], values[-1]]), profile["ci95"]

    def line(label: str, rise: np.ndarray, colour: int, dash: int = 0) -> Line:
        return Line(label, values, np.where(rise <= HIGHEST_RISE, rise, np.nan), colour=colour, dash=dash)

    lines = [
        line("profile likelihood", profile["rise"], 0),
        Line("95 %", ends, np.full(2, CHI2_RISE_95_PERCENT), colour=COLOUR_COUNT - 1, dash=1),
    ]
    if sd > 0.0:
        lines.append(line("curvature at the optimum", ((values - best) / (wider * sd)) ** 2, 1, 1))
        half = CHI2_RISE_95_PERCENT**0.5 * sd
        if wider > 1.0:
            label = f"95 % from independent noise alone ({number(wider, 2)} times narrower)"
            x, foot = np.clip([best - half, best + half], *ends), np.zeros(2)
            lines.append(Line(label, x, foot, "band", colour=2, y_high=foot + HIGHEST_RISE))
    return chart(
        f"{name} = {best:.4g}{unit}, 95 %: {low:.4g} to {high:.4g}",
        lines,
        x_label=f"{name} (Pa)" if unit else name,
        y_label="increase of χ²" + (f" over {number(wider, 2)}²" if wider > 1.0 else ""),
        spans=[(max(low, values[0]), min(high, values[-1]))],
    )


def curves_table(group: IdentifiedGroup) -> PageTable | None:
    """The errors of the curves."""
    shown = group.get("curves", {})
    largest = max((row["nrmse"] for row in shown.values() if finite(row["nrmse"])), default=0.0)
    rows = [
        (
            name,
            SIDES_OF_A_FIT[row["split"]],
            f"{row['rows']}",
            f"{row['rows_left_out']}" if row["rows_left_out"] else "",
            f"{number(row['rmse'])} {row['unit']}",
            _share(row["nrmse"]),
            f"{number(row['largest_error'])} {row['unit']}",
            bars([None, row["nrmse"]], None, largest),
        )
        for name, row in shown.items()
    ]
    return table(("curve", "", "rows", "not used", "rmse", "of the largest value", "largest error", ""), rows, "ttnnnnnb")


def _share(share: float) -> str:
    """A share of one in per cent, to three digits: laws and curves often differ by less than two digits show."""
    return f"{number(100.0 * share)} %"


def hides_table(group: IdentifiedGroup) -> PageTable | None:
    """The constants with other assumptions."""
    symbols = [constant_name(name) for name in group.get("constants", {})]
    rows: list[tuple[Any, ...]] = []
    for row in group.get("hides", []):
        if "problem" in row:
            rows.append((row["if"], row["problem"], *("" for _ in range(len(symbols) + 1))))
            continue
        changes = (f"{100.0 * cast(float, row.get(f'{symbol}_change', 0.0)):+.1f} %" for symbol in symbols)
        rows.append(
            (
                row["if"] + (" *" if row["left_open"] else ""),
                *changes,
                f"{number(row['left'], 2)} {group['unit']}",
                number(row["left_in_noise"], 2),
            )
        )
    head = ("other assumption", *symbols, "residual (rms)", "in noise")
    return table(head, rows, "t" + "n" * (len(symbols) + 2))


def facts_of(group: IdentifiedGroup) -> Iterator[tuple[str, str]]:
    """Names and values of misfit, noise and assumptions."""
    if "misfit" in group:
        misfit = group["misfit"]
        text = f"{number(misfit['rms'])} {group['unit']} rms, {percent(misfit['nrmse'])} of the largest value"
        if finite(misfit["reduced_chi2"]):
            text += f"; reduced χ² {number(misfit['reduced_chi2'])}"
        yield "misfit of the law", text
    if "noise_sd" in group:
        unit = group["unit"]
        noise = f"{number(group['noise_sd'], 2)} {unit} ({group['noise']}); numerical {number(group['numerical_sd'], 2)} {unit}"
        yield "noise of a row", noise
    if finite(group.get("chi2")):
        yield "χ²", f"{number(group['chi2'], 4)} with {plural(group['degrees_of_freedom'], 'degree')} of freedom"
    if finite(group.get("correlation")):
        yield "correlation of the constants", f"{group['correlation']:+.2f}"
    if "paper" in group:
        paper = group["paper"]
        limits = f"(α {1e3 * paper['alpha_mm']:g} µm, β {1e3 * paper['beta_mm']:g} µm)"
        yield "paper's method", f"{group['status']} in {plural(len(paper['trace']), 'run')} {limits}"
        yield (
            "verdict",
            f"{sum(paper['within'])} of {len(paper['within'])} points within {paper['tolerance']}; largest error "
            f"{percent(paper['largest_relative_error'])}",
        )
    if group.get("assumed"):
        yield "assumed", ", ".join(group["assumed"])
