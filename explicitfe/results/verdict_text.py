"""The verdict of a closed loop in words: one headline and its details, from the verdict and the posterior of the document.

Terminal, JSON and page take their words from here, so that they agree with each other and with the probabilities below them.
"""

from __future__ import annotations

from collections.abc import Sequence

from explicitfe.results.loop_report import LoopReport

NOTHING, OTHER = "nothing", "other"
CAUSES_IN_WORDS = {NOTHING: "no missing effect", OTHER: "an effect outside the library"}
JOINED_BY = " + "
# A cause with at least this probability is named alone; else those are listed whose probability is this share of the largest.
DOMINANT_PROBABILITY, LISTED_SHARE, MOST_LISTED = 0.5, 0.25, 3


def effect_title(report: LoopReport, effect: str | None) -> str:
    """The name of an effect in words."""
    return report.effect_titles.get(effect or "") or str(effect or "").replace("-", " ")


def joined(names: Sequence[str], word: str = "and") -> str:
    """Such as "a, b and c"."""
    return f"{', '.join(names[:-1])} {word} {names[-1]}" if len(names) > 1 else "".join(names)


def headline(report: LoopReport) -> str:
    """The verdict in a few words, without a full stop."""
    match report.verdict:
        case "failed":
            return "The fit failed"
        case "no-missing-effect" if report.no_consequence:
            return "No relevant effect is missing"
        case "no-missing-effect" if _residual_is_significant(report):
            return "A missing effect cannot be excluded"
        case "no-missing-effect":
            return "No missing effect is detected"
        case "limited-by-numerics":
            return "The residual is within the discretization error"
        case "unexplained" if _names_a_cause(report):
            return f"{_causes(report)}; a residual remains that no candidate explains"
        case "unexplained":
            return "An effect is missing that no candidate explains"
        case "effect-found" if report.effects and _includes_most_probable(report):
            return f"The model lacks {joined(_titles(report, report.effects))}"
        case "effect-found" | "ambiguous":
            return _causes(report)
    return f"Verdict: {report.verdict or 'none'}"


def details(report: LoopReport) -> str:
    """What the verdict rests on, in one or two sentences."""
    match report.verdict:
        case "failed":
            return f"{_with_full_stop(report.message)} A failed fit does not show what the model lacks.".lstrip()
        case "no-missing-effect" if report.no_consequence:
            slight = _capital(joined(_titles(report, report.no_consequence)))
            verb = "are" if len(report.no_consequence) > 1 else "is"
            does = "do" if len(report.no_consequence) > 1 else "does"
            return f"{slight} {verb} statistically significant but {does} not improve the prediction of held-out tests."
        case "no-missing-effect" if _residual_is_significant(report):
            return "Noise alone plausibly explains this residual."
        case "no-missing-effect":
            return f"The baseline model fits these data within the noise.{_unlikely_nothing(report)}"
        case "limited-by-numerics":
            return "This error is too large to decide whether an effect is missing."
        case "unexplained" if report.nearest:
            return f"The model with {joined(_titles(report, report.nearest))} leaves a significant residual."
        case "effect-found" if _includes_most_probable(report):
            return " ".join(filter(None, (_undetermined(report), REMAINDERS.get(report.remainder or "", ""))))
        case "effect-found" | "ambiguous" if len(report.split.fit) == 1:
            return "One test alone cannot confirm a cause."
        case "effect-found" | "ambiguous":
            return "These data do not distinguish the causes."
    return ""


def sentence(report: LoopReport) -> str:
    """Headline and details."""
    return " ".join(filter(None, (f"{headline(report)}.", details(report))))


REMAINDERS = {
    "at-floor": "The residual is within the noise and the numerical error.",
    "form": "The small residual may be a model-form error of the relaxation.",
    "unexplained": "The residual contains another effect that no candidate explains.",
    "ambiguous": "The residual contains another effect that several candidates explain equally well.",
}


def cause_in_words(report: LoopReport, cause: str) -> str:
    """A cause of the posterior in words, such as "softening and compliance of the rig"."""
    return CAUSES_IN_WORDS.get(cause) or joined(_titles(report, cause.split(JOINED_BY)))


def _causes(report: LoopReport) -> str:
    """The most probable causes; without probabilities, the effects that the search could not distinguish."""
    causes = [(cause, p) for cause, p in report.posterior.items() if cause != NOTHING]
    if not causes:
        return _rivals(report)
    causes.sort(key=lambda entry: -entry[1])
    top, largest = causes[0]
    if largest >= DOMINANT_PROBABILITY:
        return f"Most probable cause: {cause_in_words(report, top)} (probability {largest:.2f})"
    listed = [f"{cause_in_words(report, cause)} ({p:.2f})" for cause, p in causes if p >= LISTED_SHARE * largest]
    return f"Ambiguous cause: {joined(listed[:MOST_LISTED], 'or')}"


def _rivals(report: LoopReport) -> str:
    rivals = list(dict.fromkeys([*report.effects[-1:], *report.ambiguous_with]))
    sure = [name for name in report.effects if name not in rivals]
    if not rivals:
        return "Ambiguous cause"
    if len(rivals) == 1 and not sure:
        return f"Possible cause: {effect_title(report, rivals[0])}"
    listed = joined(_titles(report, rivals), "or")
    return f"The model lacks {joined(_titles(report, sure))}; further cause: {listed}" if sure else f"Ambiguous cause: {listed}"


def _includes_most_probable(report: LoopReport) -> bool:
    """Whether the effects of the verdict are part of the most probable cause; so if there are no probabilities."""
    if not report.posterior:
        return True
    top = max(report.posterior, key=report.posterior.__getitem__)
    return set(report.effects) <= set(top.split(JOINED_BY))


def _names_a_cause(report: LoopReport) -> bool:
    """Whether a named cause is more probable than an effect outside the library alone."""
    top = max(report.posterior, key=report.posterior.__getitem__, default=OTHER)
    return top not in (NOTHING, OTHER)


def _residual_is_significant(report: LoopReport) -> bool:
    """Whether the baseline leaves a significant residual."""
    p = report.steps[0].p_residual if report.steps else None
    limit = report.thresholds.get("significance_p")
    return p is not None and limit is not None and limit.value is not None and p <= limit.value


def _unlikely_nothing(report: LoopReport) -> str:
    """A remark where the posterior favours a cause although the residual is not significant."""
    cause, p = max(report.posterior.items(), key=lambda entry: entry[1], default=(NOTHING, 1.0))
    return "" if cause == NOTHING else f" The most probable cause is nevertheless {cause_in_words(report, cause)} ({p:.2f})."


def _undetermined(report: LoopReport) -> str:
    names = _titles(report, report.strength_undetermined)
    return f"The strength of {joined(names)} is not determined." if names else ""


def _titles(report: LoopReport, effects: Sequence[str]) -> list[str]:
    return [effect_title(report, name) for name in effects]


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _with_full_stop(text: str) -> str:
    return f"{_capital(text.rstrip('.'))}." if text else ""
