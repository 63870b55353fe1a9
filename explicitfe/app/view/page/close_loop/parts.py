"""What each part of the page says, from a report: texts, lists and tables, without a mark of HTML."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from explicitfe.app.view.page.close_loop.pictures import ROWS_WITHOUT_MEAN
from explicitfe.app.view.page.close_loop.reading import assumed_values, has_changed, mean_error, noise_is_known
from explicitfe.app.view.page.tables import Bars, PageTable, bars, table
from explicitfe.app.view.page.words import (
    DASH,
    VERDICTS,
    bare,
    baseline_name,
    count,
    finite,
    how_sure,
    model_names,
    name_and_unit,
    number,
    percent,
    plural,
    quantity,
    sentence,
    shortened,
    values_in_words,
    with_interval,
    worth_of,
)
from explicitfe.results.documents.loop_report import LoopReport, ReportCurve, ReportedHypothesis, estimates
from explicitfe.results.documents.report_part import Side
from explicitfe.results.documents.verdict_text import (
    JOINED_BY,
    cause_title,
    details,
    effect_title,
    form_in_words,
    headline,
    joined,
    named_forms,
    probability,
    set_in_words,
    strength,
)

# A longer headline gets smaller letters, so that it takes two lines at most.
LONG_HEADLINE_LETTERS = 62
# Lines beside the first picture: more would push it off the screen.
MOST_FACTS = 8
SHARE_HEAD = "share of the largest plausible one"
# Further hypotheses are folded away.
HYPOTHESES_SHOWN = 10


@dataclass(frozen=True)
class FirstScreen:
    """What is seen without scrolling; empty texts are left out.

    Attributes
    ----------
    title, note : of the errors before and after, on held-out curves where there are any.
    numbers : "before" or "after", the error, and its label.
    facts : lines beside the first picture, and the part of the page that each leads to.
    """

    eyebrow: str
    headline: str
    is_long: bool
    sentence: str
    next_experiment: str
    left: str
    title: str
    note: str
    numbers: list[tuple[str, str, str]]
    bars: Bars | None
    facts: list[tuple[str, str]]


def first_screen(report: LoopReport) -> FirstScreen:
    """What is seen without scrolling."""
    names = [shortened(name, 130) for name in (report.dataset, report.title) if name]
    following = report.next_experiment
    left = [sentence(report.remainder_where), how_sure(report)]
    head = headline(report)
    held_out = finite(mean_error(report.baseline, "holdout").nrmse)
    side: Side = "holdout" if held_out else "fit"
    changed = has_changed(report)
    models = (report.baseline, report.final) if changed else (report.baseline,)
    errors = [mean_error(model, side).nrmse for model in models]
    rows = [row for row in report.baseline.error.curves.values() if row.split == side]
    floors = [row.floor for row in rows if finite(row.floor)]
    floor = float(np.mean(floors)) if floors else None
    curves = len(rows) or len(report.split.holdout if held_out else report.split.fit)
    title = f"Error on {plural(curves, 'held-out curve' if held_out else 'fitted curve') if curves else 'the curves'}"
    note = "whole curves that the fit did not see" if held_out else "no curve was held out: this shows the fit, not a prediction"
    before, after = model_names(report)
    labels = [f"before: {before}", f"after: {after}"] if changed else [before]
    numbers = [(stage, percent(error), label) for error, label, stage in zip(errors, labels, ("before", "after"), strict=False)]
    largest = max([x for x in (*errors, floor) if finite(x)], default=0.0)
    return FirstScreen(
        eyebrow=": ".join(names) or "closed loop",
        headline=head,
        is_long=len(head) > LONG_HEADLINE_LETTERS,
        sentence=details(report),
        next_experiment=sentence(following.protocol) if following else "",
        left=" ".join(filter(None, left)),
        title=title,
        note=note,
        numbers=numbers if any(map(finite, errors)) else [],
        bars=bars(errors, floor, largest),
        facts=_facts(report, side, floor),
    )


def _facts(report: LoopReport, side: Side, floor: float | None) -> list[tuple[str, str]]:
    """The lines beside the first picture."""
    changed = has_changed(report)
    models = (report.baseline, report.final) if changed else (report.baseline,)
    rmse = [mean_error(model, side).rmse for model in models]
    facts = []
    if any(map(finite, rmse)):
        facts.append(f"That is {' → '.join(number(x, 2) for x in rmse)} {report.unit or ''} root mean square.")
    if finite(floor):
        facts.append(f"Floor {percent(floor)}: what noise and numerics leave by themselves.")
    if side == "holdout" and finite(mean_error(report.baseline, "fit").nrmse):
        fitted = [percent(mean_error(model, "fit").nrmse) for model in models]
        facts.append(f"{plural(len(report.split.fit), 'fitted curve')}: {' → '.join(fitted)}.")
    if finite(report.n_eff):
        facts.append(f"The fit rests on {count(report.n_eff)} independent data{_of_rows(report)}.")
    for (key, group), estimate in estimates(report.final.parameters).items():
        if changed and "." in key and len(facts) < MOST_FACTS:
            words, unit = name_and_unit(report, key)
            doubt = ", not determined" if key in report.undetermined else ""
            facts.append(f"{words}{f' of {group}' if group else ''} {with_interval(estimate)} {unit}".rstrip() + f"{doubt}.")
    links = [(f"{plural(len(report.split.left_out), 'curve')} left out", "split")] if report.split.left_out else []
    if warnings := list(filter(None, report.warnings)):
        links.append((plural(len(warnings), "warning"), "warnings"))
    return [*((text, "") for text in facts), *links]


def _of_rows(report: LoopReport) -> str:
    """How many rows the fitted curves have, in words; empty where it is not known of all."""
    fitted = report.split.fit
    rows = [row.n for row in report.noise.rows if not fitted or row.curve in fitted]
    known = [n for n in rows if finite(n)]
    return f" in {count(sum(known))} rows" if rows and len(known) == len(rows) else ""


def causes(report: LoopReport) -> PageTable | None:
    """The causes that these data can show, their forms, and the smallest strength that they would show."""
    tested = {name: one for name, one in report.causes.items() if one.decision != "not-testable"}
    rows = [
        (
            cause_title(report, name),
            probability(one.probability if finite(one.probability) else None),
            one.decision,
            ", ".join(f"{form} {probability(p)}" for form, p in named_forms(report, name).items()),
            strength(one),
            percent(one.detectable_share),
        )
        for name, one in tested.items()
    ]
    head = ("cause", "probability", "decision", "forms", "smallest detectable strength", SHARE_HEAD)
    return table(head, rows, "tntwnn", [one.decision == "present" for one in tested.values()])


def not_testable(report: LoopReport) -> PageTable | None:
    """Causes that may be present but cannot be tested with these data."""
    rows = [(cause_title(report, name), one.reason) for name, one in report.causes.items() if one.decision == "not-testable"]
    return table(("cause", "why"), rows, "tw")


def hypotheses(report: LoopReport) -> list[PageTable | None]:
    """The sets of effects that were compared, the most probable first: a table of these, and one of all others."""

    def cells(one: ReportedHypothesis) -> tuple[str, ...]:
        return (
            form_in_words(report, JOINED_BY.join(one.effects)) if one.effects else baseline_name(report),
            probability(one.probability if finite(one.probability) else None),
            {True: "fitted", False: "could not be computed" if one.reason else "screened", None: ""}[one.fitted],
            number(one.decrease),
            number(one.bound),
            values_in_words(report, one.parameters),
            one.reason,
        )

    head = ("effects", "probability", "", "Δχ², fitted", "largest Δχ² by the signatures", "parameters of the effects", "why")
    final = set(report.effects or report.nearest)
    chosen = [bool(one.fitted) and set(one.effects) == final for one in report.hypotheses]
    first = chosen.index(True) if True in chosen else -1
    marks = [k == first for k in range(len(chosen))]
    every = [cells(one) for one in report.hypotheses]
    parts = (slice(HYPOTHESES_SHOWN), slice(HYPOTHESES_SHOWN, None))
    return [table(head, every[part], "tntnnww", marks[part]) for part in parts] if every else []


def next_tests(report: LoopReport) -> tuple[str, str, PageTable | None] | None:
    """The test that would settle best what is open, what it is worth, and a table of the next best; None without any."""
    proposed = report.proposed_tests or ([report.next_experiment] if report.next_experiment else [])
    tests = [one for one in proposed if one.protocol]
    if not tests:
        return None
    rows = [
        (
            sentence(one.protocol),
            joined([set_in_words(report, name) for name in one.separates], "from"),
            number(one.information_bits, 2),
            number(one.minutes, 2),
            count(one.repeats) if one.repeats else None,
        )
        for one in tests
    ]
    head = ("further tests", "distinguishes", "information gain (bits)", "duration (min)", "repeats")
    return rows[0][0], sentence(worth_of(tests[0], report)), table(head, rows[1:], "wtnnn")


def residual_caption(curves: Sequence[ReportCurve]) -> str:
    """What stands below the picture of what is left."""
    known = noise_is_known(curves)
    unit = "standard deviations of the noise" if known else "per cent of the largest measured value"
    caption = f"Measured minus model, in {unit}, over time; held-out curves first."
    if known:
        caption += " Grey band: two standard deviations; beyond them the scale is logarithmic where the misfit is large."
    if any(len(curve.measured) > ROWS_WITHOUT_MEAN for curve in curves):
        caption += " Long curves: mean of each sixtieth, and band of all its rows."
    return caption


def curve_errors(report: LoopReport) -> PageTable | None:
    """The errors of every curve, held-out ones first."""
    before, after = report.baseline.error.curves, report.final.error.curves
    changed = has_changed(report)
    every = {name: before.get(name) or after[name] for name in before | after}
    names = sorted(every, key=lambda name: every[name].split != "holdout")
    models = (before, after) if changed else (before,)
    errors = {name: [model[name].nrmse if name in model else None for model in models] for name in names}
    floors = {
        name: next((model[name].floor for model in (after, before) if name in model and finite(model[name].floor)), None)
        for name in names
    }
    largest = max((x for name in names for x in (*errors[name], floors[name]) if finite(x)), default=0.0)
    rows = [
        (
            name,
            "held out" if every[name].split == "holdout" else "fitted",
            percent(errors[name][0]),
            percent(errors[name][-1]) if changed else None,
            percent(floors[name]),
            number(models[-1][name].rmse if name in models[-1] else None, 2),
            bars(errors[name], floors[name], largest),
        )
        for name in names
    ]
    head = (
        "curve",
        "",
        "before" if changed else "error",
        "after",
        "floor",
        f"rmse {'after ' if changed else ''}({report.unit or 'unit of the data'})",
        "before, after; line: floor" if changed else "line: floor",
    )
    return table(head, rows, "ttnnnnb")


def constants(report: LoopReport) -> PageTable | None:
    """Fitted constants before and after, with their intervals."""
    before, after = estimates(report.baseline.parameters), estimates(report.final.parameters)
    changed = has_changed(report)
    rows = [
        (
            quantity(report, key),
            group,
            with_interval(before.get((key, group))),
            with_interval(after.get((key, group))) if changed else None,
            f"not determined: {report.undetermined[key]}" if key in report.undetermined else None,
        )
        for key, group in dict.fromkeys([*before, *after])
    ]
    head = ("", "of", "before (95 % interval)" if changed else "value (95 % interval)", "after (95 % interval)", "")
    return table(head, rows, "ttnnw")


def noise(report: LoopReport) -> PageTable | None:
    """Noise of the rows of each curve."""
    unit = f" ({report.unit})" if report.unit else ""
    source = {True: "stated with the data", False: "estimated", None: DASH}
    rows = [
        (row.curve, number(row.sd, 2), number(row.rho, 2), source[row.stated], count(row.n), count(row.n_eff))
        for row in report.noise.rows
    ]
    head = ("curve", f"noise of a row, sd{unit}", "correlation of rows", "noise is", "rows", "independent data")
    return table(head, rows, "tnntnn")


def numerical(report: LoopReport) -> PageTable | None:
    """Numerical errors next to the noise."""
    rows = [(row.what, percent(row.share_of_noise)) for row in report.noise.numerical]
    return table(("numerics: change of the prediction with", "share of the noise"), rows, "tn")


def scatter(report: LoopReport) -> list[str]:
    """The number of independent data and the scatter of whole curves, in words."""
    lines = [f"{count(report.n_eff)} independent data{_of_rows(report)}."] if finite(report.n_eff) else []
    if finite(report.noise.scale_sd):
        lines.append(f"Scatter of whole curves in scale: {percent(report.noise.scale_sd)}.")
    if finite(report.noise.offset_sd):
        lines.append(f"Scatter of whole curves in offset: {number(report.noise.offset_sd, 2)} {report.unit or ''}.")
    return lines


def assumed(report: LoopReport) -> PageTable | None:
    """What follows from other values of what the dataset assumes."""
    rows = [
        (
            quantity(report, key) if position == 0 else "",
            bare(row.value) if finite(row.value) else str(row.value or ""),
            VERDICTS.get(row.verdict or "", ""),
            joined([effect_title(report, name) for name in row.effects]),
            percent(row.error_fit),
            values_in_words(report, row.parameters),
        )
        for key, values in assumed_values(report).items()
        for position, row in enumerate(values)
    ]
    return table(("assumed", "value", "verdict", "effects", "error of the fit", "parameters"), rows, "tnttnw")


def provenance(report: LoopReport) -> PageTable | None:
    """What has to be known to compute the report again."""
    rows = [
        (key, value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str))
        for key, value in report.provenance.items()
        if value is not None
    ]
    return table(("", ""), rows, "tt")
