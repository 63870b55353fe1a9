"""The verdict of a closed loop in words: one headline and its details, from the verdict and the probabilities of the document.

Terminal, JSON and page take their words from here, so that they agree with each other and with the probabilities below them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from explicitfe.results.documents.loop_report import LoopReport, ReportedCause
from explicitfe.results.documents.units_of_keys import words_and_unit

NOTHING, OTHER = "nothing", "other"
SETS_IN_WORDS = {NOTHING: "no missing effect", OTHER: "something that no candidate describes"}
JOINED_BY = " + "
# Forms whose name is not the title of their effect, by the number of their terms.
PRONY_TERMS = {"viscoelastic": "Prony term"}
COUNTS = ("no", "one", "two", "three", "four", "five")
# The headline names at most so many sets of causes, the details at most so many sets and so many detectable strengths.
MOST_SETS_IN_HEADLINE, MOST_SETS, MOST_STRENGTHS = 2, 6, 5
# Probabilities nearer to 0 and 1 are printed as bounds.
SMALLEST_SAID_PROBABILITY = 0.005


def effect_title(report: LoopReport, effect: str | None) -> str:
    """The name of an effect in words."""
    return report.effect_titles.get(effect or "") or str(effect or "").replace("-", " ")


def cause_title(report: LoopReport, cause: str) -> str:
    """The name of a cause in words."""
    known = report.causes.get(cause)
    return known.title if known and known.title else effect_title(report, cause)


def set_in_words(report: LoopReport, name: str) -> str:
    """A set of causes, as a key of the posterior, in words: "relaxation and compliance of the rig"."""
    return SETS_IN_WORDS.get(name) or joined([cause_title(report, cause) for cause in name.split(JOINED_BY)])


def form_in_words(report: LoopReport, form: str) -> str:
    """A form of a cause, as its effects joined by " + ", in words: "two Prony terms"."""
    parts = []
    for effect, count in Counter(form.split(JOINED_BY)).items():
        number = COUNTS[count] if count < len(COUNTS) else str(count)
        title = effect_title(report, effect)
        if noun := PRONY_TERMS.get(effect):
            parts.append(f"{number} {noun}{'' if count == 1 else 's'}")
        else:
            parts.append(title if count == 1 else f"{number} terms of {title}")
    return joined(parts)


def named_forms(report: LoopReport, cause: str) -> dict[str, float]:
    """Form of a cause in words -> probability, the most probable first; empty where the only form has the name of the cause."""
    known = report.causes.get(cause) or ReportedCause()
    forms = {form_in_words(report, form): p for form, p in sorted(known.forms.items(), key=lambda entry: -entry[1])}
    return {} if list(forms) == [cause_title(report, cause)] or list(forms) == [effect_title(report, cause)] else forms


def joined(names: Sequence[str], word: str = "and") -> str:
    """Such as "a, b and c"."""
    return f"{', '.join(names[:-1])} {word} {names[-1]}" if len(names) > 1 else "".join(names)


def probability(p: float | None) -> str:
    """A probability to two decimals, as a bound where it is close to 0 or 1; "" where there is none."""
    if p is None:
        return ""
    if p < SMALLEST_SAID_PROBABILITY:
        return "< 0.01"
    return "> 0.99" if p >= 1.0 - SMALLEST_SAID_PROBABILITY else f"{p:.2f}"


def headline(report: LoopReport) -> str:
    """The verdict in a few words, without a full stop."""
    match report.verdict:
        case "failed":
            return "The fit failed"
        case "no-missing-effect" | "limited-by-numerics":
            return f"Nothing is missing that these data could show{_of_compared(report, report.sure)}"
        case "unexplained":
            return f"Something is missing that no candidate describes{_of_compared(report, report.something_else)}"
        case "effect-found":
            causes = present_causes(report)
            named = joined([cause_title(report, cause) for cause in causes])
            return f"The model lacks {named or 'an effect'}{_of_compared(report, _of_all(report, causes))}"
        case "ambiguous":
            listed = [_with_probability(report, name) for name in credible_sets(report)]
            few = listed[:MOST_SETS_IN_HEADLINE] if len(listed) > MOST_SETS_IN_HEADLINE + 1 else listed
            others = [f"one of {len(listed) - len(few)} other sets"] if len(few) < len(listed) else []
            return f"Ambiguous cause: {joined([*few, *others], 'or')}" if listed else "Ambiguous cause"
    return f"Verdict: {report.verdict or 'none'}"


def details(report: LoopReport) -> str:
    """What the verdict rests on, in a few sentences."""
    match report.verdict:
        case "failed":
            return f"{_with_full_stop(report.message)} A failed fit does not show what the model lacks.".lstrip()
        case "no-missing-effect":
            return _detectable(report)
        case "limited-by-numerics":
            parts = [_detectable(report), "The numerical error is too large to decide more.", _numerical_error(report)]
        case "unexplained":
            causes = _causes_of(report, report.nearest)
            named = _capital(joined([cause_title(report, cause) for cause in causes]))
            verb = "explain" if len(causes) > 1 else "explains"
            parts = [f"{named} {verb} part of the residual{_in_brackets(_of_all(report, causes))}." if causes else ""]
        case "effect-found":
            parts = [_best_forms(report), _undecided(report), _undetermined(report), REMAINDERS.get(report.remainder or "", "")]
        case "ambiguous":
            parts = [_credible(report), "These data do not distinguish the causes."]
        case _:
            parts = []
    return " ".join(filter(None, parts))


def sentence(report: LoopReport) -> str:
    """Headline and details."""
    return " ".join(filter(None, (f"{headline(report)}.", details(report))))


REMAINDERS = {
    "at-floor": "The residual is within the noise and the numerical error.",
    "form": "The residual contains a model-form error: no single form describes it within the noise.",
}


def present_causes(report: LoopReport) -> list[str]:
    """Causes that are present; without decisions, those of the effects that were found."""
    return [name for name, one in report.causes.items() if one.decision == "present"] or _causes_of(report, report.effects)


def credible_sets(report: LoopReport) -> list[str]:
    """The smallest collection of sets of causes with 95 %; "nothing" also with something that no candidate describes."""
    sets = report.credible or list(report.posterior)
    with_other = NOTHING in sets and OTHER not in sets and OTHER in report.posterior
    return sorted([*sets, *([OTHER] if with_other else [])], key=lambda name: -report.posterior.get(name, 0.0))


def detectable_strengths(report: LoopReport) -> list[tuple[str, str]]:
    """Cause and its smallest strength that these data would show, such as ("relaxation", "g = 0.03"); the easiest first.

    The easiest is that with the smallest share of the largest plausible strength. One that is not below it is left out.
    """
    causes = [(name, one) for name, one in report.causes.items() if one.detectable is not None and one.parameter]
    shares = {name: 1.0 if one.detectable_share is None else one.detectable_share for name, one in causes}
    shown = [(name, one) for name, one in causes if one.detectable_share is None or one.detectable_share < 1.0]
    return [(cause_title(report, name), strength(one)) for name, one in sorted(shown, key=lambda entry: shares[entry[0]])]


def strength(cause: ReportedCause) -> str:
    """The smallest detectable strength with its unit, or with its name where it has none; "" where it is not known."""
    if cause.detectable is None:
        return ""
    words, unit = words_and_unit((cause.parameter or "").rpartition(".")[2])
    value = f"{float(f'{cause.detectable:.1e}'):g}"  # two digits, without a power of ten where it can be avoided
    return f"{value} {unit}".replace(" 1/", "/") if unit else f"{words} = {value}"


def _detectable(report: LoopReport) -> str:
    listed = [f"{title} from {value}" for title, value in detectable_strengths(report)[:MOST_STRENGTHS]]
    return f"Detectable: {', '.join(listed)}." if listed else ""


def _numerical_error(report: LoopReport) -> str:
    """The largest numerical error, and what makes it smaller."""
    errors = [(one.share_of_noise or 0.0, one.what or "") for one in report.noise.numerical]
    share, what = max((e for e in errors if not e[1].startswith(("assumed ", "protocol of "))), default=(0.0, ""))
    largest = f"Its largest part is {share:.2g} times the noise ({what}). " if what else ""
    return f"{largest}A spherical tool or one with a well-rounded edge has a smaller error of the mesh."


def _best_forms(report: LoopReport) -> str:
    """The best form of each cause that is present and has several."""
    causes = present_causes(report)
    best = [(cause, next(iter(forms.items()))) for cause in causes if (forms := named_forms(report, cause))]
    whose = {cause: f" of {cause_title(report, cause)}" if len(causes) > 1 else "" for cause, _ in best}
    return " ".join(f"Best form{whose[cause]}: {form}{_in_brackets(p)}." for cause, (form, p) in best)


def _undecided(report: LoopReport) -> str:
    listed = []
    for cause in report.ambiguous_with:
        p = report.causes[cause].probability if cause in report.causes else None
        listed.append(f"{cause_title(report, cause)}{f' ({probability(p)})' if p is not None else ''}")
    return f"Not decided: {joined(listed)}." if listed else ""


def _credible(report: LoopReport) -> str:
    listed = [_with_probability(report, name) for name in credible_sets(report)]
    if len(listed) <= MOST_SETS_IN_HEADLINE + 1:
        return ""
    limit = report.thresholds.get("credible_set")
    share = 100.0 * (limit.value if limit and limit.value is not None else 0.95)
    further = len(listed) - MOST_SETS
    few = joined([*listed[:MOST_SETS], *([f"{further} more"] if further > 0 else [])])
    return f"{len(listed)} sets of causes hold {share:.0f} % together: {few}."


def _undetermined(report: LoopReport) -> str:
    names = [effect_title(report, name) for name in report.strength_undetermined]
    return f"The strength of {joined(names)} is not determined." if names else ""


def _causes_of(report: LoopReport, effects: Sequence[str]) -> list[str]:
    """Causes of which effects are forms."""
    forms = {part: name for name, one in report.causes.items() for form in one.forms for part in form.split(JOINED_BY)}
    return list(dict.fromkeys(forms.get(effect, effect) for effect in effects))


def _of_all(report: LoopReport, causes: Sequence[str]) -> float | None:
    """Probability that all of these causes are present, alone or with others; None where it is not known."""
    if len(causes) == 1 and causes[0] in report.causes:
        return report.causes[causes[0]].probability
    if not report.posterior:
        return report.sure
    return sum(p for name, p in report.posterior.items() if set(causes) <= set(name.split(JOINED_BY)))


def _with_probability(report: LoopReport, name: str) -> str:
    p = report.posterior.get(name)
    return f"{set_in_words(report, name)}{f' ({probability(p)})' if p is not None else ''}"


def _in_brackets(p: float | None) -> str:
    return "" if p is None else f" (probability {probability(p)})"


def _of_compared(report: LoopReport, p: float | None) -> str:
    """A probability, and what it counts where a limit has cut the search off: only what was fitted."""
    if not report.cut_off:
        return _in_brackets(p)
    among = f"among the {report.fitted} of {report.compared} hypotheses that were fitted before the limit"
    return f" ({among})" if p is None else f" (probability {probability(p)} {among})"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _with_full_stop(text: str) -> str:
    return f"{_capital(text.rstrip('.'))}." if text else ""
