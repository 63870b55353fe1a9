"""A compact law from the data of homogeneous tests: which polynomials of the invariants, fading in which times.

The dictionary is what the simulator answers to one unit of each coefficient, in the model that the search ended with, less its
own relaxation: stress is linear in the coefficients. A sparse regression chooses few (``sparse``), the simulator fits them with
all other parameters, and left-out tests decide whether the law is told at all. It never decides a verdict: that something is not
explained by any named cause stays true, however well a polynomial follows it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from explicitfe.fem.effects import EFFECTS, MaterialEffect
from explicitfe.fem.effects.effect import Sought
from explicitfe.fem.effects.material.discovered_law import COEFFICIENT, MONOMIALS, coefficient_name
from explicitfe.inverse.close_loop.compared import Entry
from explicitfe.inverse.close_loop.discovery.sparse import Regression, sparse
from explicitfe.inverse.close_loop.evidence import log_odds_of_other
from explicitfe.inverse.close_loop.specimens.specimens import Specimens
from explicitfe.inverse.close_loop.statistics.covariance import Covariance, measured_rows, stack
from explicitfe.inverse.close_loop.statistics.intervals import left_out_error
from explicitfe.inverse.close_loop.statistics.refit import BestFit, derivatives, refit
from explicitfe.inverse.close_loop.statistics.system import Hypothesis, Parameter, Term
from explicitfe.inverse.measured.curve import Curve, programme_of
from explicitfe.inverse.predict.tissue import Tissue
from explicitfe.platform.errors import RunError

LAW = "discovered-law"
# Relaxation times [s] that a branch may have, two a decade. Those shorter than this share of the time in which the fastest test
# comes to its largest strain are not seen, and those longer than so many durations look like an elastic law.
TIMES_S = tuple(float(f"{a}e{k}") for k in range(-3, 6) for a in (1, 3))
SHORTEST_SHARE_OF_RAMP, LONGEST_DURATIONS = 0.1, 3.0
# Fewer tests do not say what another one would read; a law must lower the error of tests left out in turn by this share.
FEWEST_TESTS, LEAST_GAIN_SHARE = 3, 0.02
# A law of more terms is no law that anybody would write down.
MOST_TERMS_OF_A_LAW = 8
# C10 keeps this share of what the search ended with.
SMALLEST_C10_SHARE = 0.05
# A coefficient may grow to so many times the stiffness of the first fit.
LARGEST_COEFFICIENT_RATIO = 1e4


@dataclass(frozen=True, eq=False)
class Discovery:
    """A law that was composed.

    Attributes
    ----------
    fit, tissue : the model with it, at its best.
    instead_of : effects of the search's model that it takes the place of.
    cv, cv_before : mean error of left-out tests with it, and with the search's model.
    """

    fit: BestFit
    tissue: Tissue
    instead_of: tuple[str, ...]
    cv: float
    cv_before: float

    @property
    def terms(self) -> list[tuple[str, float, float]]:
        """Of each term of the law its polynomial in words, its time [s] (0 never fades) and its coefficient [Pa]."""
        return [
            (*_words(name), value)
            for effect, values in self.fit.model.of_terms()
            if effect == LAW
            for name, value in values.items()
            if value > 0.0
        ]

    @property
    def text(self) -> str:
        """The law as an equation."""
        parts = [f"{value:.3g} Pa {what}" + (f" (fades in {tau:g} s)" if tau else "") for what, tau, value in self.terms]
        return "W = Yeoh + " + " + ".join(parts)


def discover(system: Specimens, last: Entry) -> Discovery | None:
    """A compact law for what the model of a round leaves; None where there is nothing to explain, or where none foretells more.

    Parameters
    ----------
    last : the final model of the comparison.
    """
    named, covariance, model = last.fit, last.covariance, last.model
    assert named is not None and covariance is not None
    tests = list(dict.fromkeys(one.test for one in system.series))
    quiet = last.evidence.other + log_odds_of_other() < 0.0
    if quiet or system.costly(model) or len(system.groups) > 1 or len(tests) < FEWEST_TESTS:
        return None
    start = _with_stiff_law(_without_relaxation(model))
    fit = _fitted(system, start, covariance)
    if fit is None:
        return None
    before, after = (left_out_error(each, covariance) for each in (named, fit))
    if not fit.chi2 < named.chi2 or not after < (1.0 - LEAST_GAIN_SHARE) * before:
        return None
    gone = tuple(name for name in model.effects if name not in start.effects)
    return Discovery(fit, system.tissue(fit.model), gone, after, before)


def _fitted(system: Specimens, start: Hypothesis, covariance: Covariance) -> BestFit | None:
    """The model with the few coefficients that foretell best, fitted; None where there are none or it cannot be computed."""
    try:
        composed = _composed(system, start, covariance)
        if composed is None:
            return None
        fit = refit(system, composed, covariance)
        needed = _without_needless(fit.model)
        if not needed.terms or needed.terms[-1].effect != LAW:
            return None
        return fit if len(needed.x) == len(fit.model.x) else refit(system, needed, covariance)
    except RunError:
        return None


def _without_relaxation(model: Hypothesis) -> Hypothesis:
    """The model without effects that take the place which the law needs: a series of relaxation."""
    x, terms, at = list(model.x[: len(model.base)]), [], len(model.base)
    for term in model.terms:
        own = model.x[at : at + len(term.parameters)]
        at += len(term.parameters)
        kind = EFFECTS[term.effect]
        if not (issubclass(kind, MaterialEffect) and "relax" in kind.leaves()):
            terms.append(term)
            x += list(own)
    return Hypothesis(model.base, tuple(terms), np.array(x))


def _with_stiff_law(model: Hypothesis) -> Hypothesis:
    """The model with a C10 that cannot fall to nothing: stress that counts as none is a share of it where a state is sought."""
    C10 = model.base[0]
    stiff = replace(C10, sought=replace(C10.sought, low=SMALLEST_C10_SHARE * model.values[0]))
    return Hypothesis((stiff, *model.base[1:]), model.terms, model.x)


def _dictionary(system: Specimens, start: Hypothesis, now: np.ndarray) -> dict[str, np.ndarray]:
    """Name of each coefficient -> (n,) what one unit of it adds to the answer ``now`` (n,), SI.

    Each is tried so large that it answers about as much as the law itself, since instants are as fine as the whole answer asks.
    """
    times = [0.0]
    shortest = min(_ramp_s(c.time_s, programme_of(c)) for c in system.curves)
    if "time" in system.features:
        longest = max(float(c.time_s[-1]) for c in system.curves)
        times += [t for t in TIMES_S if SHORTEST_SHARE_OF_RAMP * shortest <= t <= LONGEST_DURATIONS * longest]
    names = [coefficient_name(powers, tau) for tau in times for powers in MONOMIALS]
    size = max(_invariant(c) for c in system.curves)
    modulus = start.values[0] + start.values[1] * size
    units = [modulus * size ** (1 - i - j) * max(1.0, shortest / tau if tau else 1.0) for tau in times for i, j in MONOMIALS]
    models = [start.plus(Term(LAW, (_parameter(n, unit, start),)), (unit,)) for n, unit in zip(names, units, strict=True)]
    columns = zip(names, units, system.answers(models), strict=True)
    return {name: (stack(answer) - now) / unit for name, unit, answer in columns if answer is not None}


def _composed(system: Specimens, start: Hypothesis, covariance: Covariance) -> Hypothesis | None:
    """The model with the few coefficients that foretell left-out tests best, near its best; None where none helps."""
    (answer,) = system.answers([start])
    if answer is None:
        return None
    now = stack(answer)
    dictionary = _dictionary(system, start, now)
    names = list(dictionary)
    target = measured_rows(system.series) - now
    columns = list(dictionary.values())
    # What the model has anyhow competes with the dictionary: its constants, and the strength of each of its effects. What they
    # give now is given back to the data. A strength of either sign has a column for each.
    constants = [coefficient_name(powers, 0.0) for powers in ((1, 0), (2, 0))]
    if any(name not in dictionary for name in constants):
        return None
    own = [(number, names.index(name), 1.0) for number, name in enumerate(constants)]
    places = _strengths(start)
    slopes = derivatives(system, start, now)[:, places] if places else np.zeros((len(now), 0))
    for number, slope in zip(places, slopes.T, strict=True):
        for sign in (1.0, -1.0) if start.parameters[number].low < 0.0 else (1.0,):
            own.append((number, len(columns), sign))
            columns.append(sign * slope)
    for number, column in {number: column for number, column, sign in own if sign > 0.0}.items():
        scale = start.values[number] if number < len(start.base) else float(start.x[number])
        target = target + scale * columns[column]
    sd = np.concatenate([row.sd for row in covariance.rows])
    tests, largest = [], []
    for one in system.series:
        tests += [one.test] * len(one.measured)
        largest += [float(np.abs(one.measured).max())] * len(one.measured)
    regression = Regression(
        np.column_stack(columns) / sd[:, None], target / sd, np.array(tests), sd / np.array(largest), [k for _, k, _ in own]
    )
    numbers = sparse(regression, MOST_TERMS_OF_A_LAW)
    values = dict(zip(numbers, regression.fitted(numbers).tolist(), strict=True))
    x = start.x.copy()
    for number in {number for number, _, _ in own}:
        total = sum(sign * values[column] for place, column, sign in own if place == number)
        p = start.parameters[number]
        x[number] = np.clip(p.sought.coordinate(max(total, p.sought.low)) if number < len(start.base) else total, p.low, p.high)
    fitted_anyhow = {column for _, column, _ in own}
    terms = {names[k]: values[k] for k in numbers if k not in fitted_anyhow and values[k] > 0.0}
    if not terms:
        return None
    term = Term(LAW, tuple(_parameter(name, value, start) for name, value in terms.items()))
    return start.at(x).plus(term, list(terms.values()))


def _without_needless(model: Hypothesis) -> Hypothesis:
    """The model without the coefficients of its law, the last term, that a fit has brought to nothing."""
    law = model.terms[-1]
    first = len(model.x) - len(law.parameters)
    left = [k for k in range(len(law.parameters)) if model.x[first + k] > 0.0]
    terms = (Term(LAW, tuple(law.parameters[k] for k in left)),) if left else ()
    return Hypothesis(model.base, (*model.terms[:-1], *terms), np.array([*model.x[:first], *(model.x[first + k] for k in left)]))


def _strengths(model: Hypothesis) -> list[int]:
    """Numbers of the parameters that are the strength of an effect: its first one, in which an answer is about linear."""
    places, at = [], len(model.base)
    for term in model.terms:
        places.append(at)
        at += len(term.parameters)
    return places


def _parameter(name: str, value: float, start: Hypothesis) -> Parameter:
    return Parameter(f"{LAW}.{name}", Sought((value,), 0.0, LARGEST_COEFFICIENT_RATIO * start.base[0].start), value)


def _words(name: str) -> tuple[str, float]:
    """The polynomial of a coefficient in words, and its time [s]."""
    parts = COEFFICIENT.fullmatch(name)
    assert parts is not None
    i, j, time, unit = parts.groups()
    factors = [f"(I{k + 1} - 3)" + (f"^{power}" if power != "1" else "") for k, power in enumerate((i, j)) if power != "0"]
    return " ".join(factors), 0.0 if time is None else float(time) * (1e-3 if unit == "ms" else 1.0)


def _invariant(curve: Curve) -> float:
    """The largest I1 - 3 of a homogeneous test."""
    programme = programme_of(curve)
    if curve.kind == "shear":
        return float(np.max(programme**2))
    if curve.tool is not None:
        assert curve.specimen is not None
        programme = 1.0 - 1e3 * programme / curve.specimen.thickness_mm
    return float(np.max(programme**2 + 2.0 / programme - 3.0))


def _ramp_s(time_s: np.ndarray, programme: np.ndarray) -> float:
    """The time in which a test comes to its farthest [s]."""
    moved = np.abs(programme - programme[0])
    return max(float(time_s[int(np.argmax(moved >= 0.99 * moved.max()))]), float(np.diff(time_s).min()))
