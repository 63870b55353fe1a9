"""``report.json``: the document that ``explicitfe close-loop`` writes and ``explicitfe view`` draws.

Every key may be missing when a report is read. A key that is null is read as if it were missing, and so is a null among the
entries of a list or a table. Keys that are not known here are kept, so that a report of a later version can be read. Only keys
that were set are written.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from pydantic import ConfigDict

from explicitfe.results.documents.document import Document
from explicitfe.results.documents.motion_report import MarkerMotion, ReportedRepeats
from explicitfe.results.documents.report_part import Entries, PartOf, ReportPart, Side, TableOf, TextOf

Verdict = Literal["failed", "no-missing-effect", "limited-by-numerics", "unexplained", "ambiguous", "effect-found"]
Remainder = Literal["at-floor", "form", "unexplained", "ambiguous"]
Decision = Literal["present", "undecided", "absent", "not-testable"]
ScatterSource = Literal["stated", "repeats", "unknown"]


class Estimate(ReportPart):
    """A fitted parameter, in the unit that its name ends with.

    Attributes
    ----------
    value : at the optimum.
    ci95 : the two ends of its 95 % interval.
    """

    model_config = ConfigDict(extra="forbid")  # a table with other keys holds an estimate for each group of constants

    value: float | None = None
    ci95: Entries[float] = []


Parameters = TableOf[Estimate | TableOf[Estimate | float] | float]


def estimates(parameters: Parameters) -> dict[tuple[str, str], Estimate]:
    """(name, group) -> estimate; the group is "" where all curves share one value."""
    flat: dict[tuple[str, str], Estimate] = {}
    for name, entry in parameters.items():
        for group, estimate in entry.items() if isinstance(entry, dict) else [("", entry)]:
            flat[name, group] = estimate if isinstance(estimate, Estimate) else Estimate(value=estimate)
    return flat


class MeanError(ReportPart):
    """Errors averaged over curves: ``nrmse`` is a share of each curve's largest measured value, ``rmse`` is in the unit."""

    nrmse: float | None = None
    rmse: float | None = None


class CurveError(ReportPart):
    """The error of one curve.

    Attributes
    ----------
    rmse : root mean square of measured minus model, in the unit of the report.
    nrmse : the same as a share of the largest measured value.
    floor : what noise and numerics leave by themselves, as the same share.
    message : why the curve could not be computed.
    """

    split: Side | None = None
    rmse: float | None = None
    nrmse: float | None = None
    floor: float | None = None
    message: str | None = None


class GroupedConstant(ReportPart):
    """A constant over several specimens.

    Attributes
    ----------
    mean : geometric mean of all such specimens, with its 95 % interval.
    spread : standard deviation of the log from specimen to specimen.
    """

    mean: Estimate | None = None
    spread: float | None = None


class ReportedGroups(ReportPart):
    """Why each specimen has constants of its own, and what they have in common.

    Attributes
    ----------
    by : what names the specimens.
    p : that equal specimens would differ as much by the scatter of tests; none where each was tested once.
    text : why, in a sentence.
    """

    by: str | None = None
    p: float | None = None
    text: TextOf = ""
    constants: TableOf[GroupedConstant] = {}


class ReportedTerm(ReportPart):
    """A term of a law: a polynomial of the invariants, its coefficient, and the time in which its stress fades; 0 never does."""

    polynomial: str | None = None
    coefficient_Pa: float | None = None
    tau_s: float | None = None


class DiscoveredLawReport(ReportPart):
    """A compact law that was composed where named effects leave something unexplained; it decides no verdict.

    Attributes
    ----------
    text : the law as an equation.
    instead_of : effects of the final model that it takes the place of.
    cv_nrmse, cv_nrmse_before : error on tests left out in turn, with it and with the final model.
    error_fit, error_holdout : mean errors with it, as shares of each curve's largest value.
    file : the model with it.
    """

    text: TextOf = ""
    terms: Entries[ReportedTerm] = []
    instead_of: Entries[str] = []
    cv_nrmse: float | None = None
    cv_nrmse_before: float | None = None
    error_fit: float | None = None
    error_holdout: float | None = None
    file: str | None = None


class ErrorsOfModel(ReportPart):
    """Errors of a model: means over the fitted and over the held-out curves, and each curve."""

    fit: MeanError | None = None
    holdout: MeanError | None = None
    curves: TableOf[CurveError] = {}


class ReportedModel(ReportPart):
    """A model of the report: the baseline, or the final one."""

    parameters: Parameters = {}
    error: PartOf[ErrorsOfModel] = ErrorsOfModel()


class ReportedSplit(ReportPart):
    """Which curves were fitted, held out or left out.

    Attributes
    ----------
    left_out : curve -> why.
    rule : how the choice was made, in words.
    """

    fit: Entries[str] = []
    holdout: Entries[str] = []
    left_out: TableOf[str] = {}
    rule: TextOf = ""


class ReportedNoise(ReportPart):
    """Noise of the rows of one curve.

    Attributes
    ----------
    sd : standard deviation of a row, in the unit of the report.
    rho : correlation of neighbouring rows.
    stated : whether the dataset states it.
    n, n_eff : number of rows, and of independent rows that say as much.
    """

    curve: str | None = None
    sd: float | None = None
    rho: float | None = None
    stated: bool | None = None
    n: int | None = None
    n_eff: float | None = None


class NumericalFloor(ReportPart):
    """How much another way of computing changes the answer, as a share of the noise."""

    what: str | None = None
    share_of_noise: float | None = None


class NoiseAndFloors(ReportPart):
    """What is not physics.

    Attributes
    ----------
    scale_sd, offset_sd : scatter of whole tests, as shares of their size and of their largest value.
    scatter_source : where this scatter is known from.
    text : more in words.
    """

    rows: Entries[ReportedNoise] = []
    scale_sd: float | None = None
    offset_sd: float | None = None
    scatter_source: ScatterSource | None = None
    numerical: Entries[NumericalFloor] = []
    text: TextOf = ""


class ReportedHypothesis(ReportPart):
    """A set of effects that was compared with the data.

    Attributes
    ----------
    causes, effects : its causes, and the forms of them, one for each term.
    probability : posterior probability of this form of the set, alone, with a model-form error or with something else.
    fitted : whether it was fitted; else the numbers are those of its screening, which is linear in the strengths.
    chi2, decrease : whitened sum of squares, and by how much it is smaller than that of the baseline.
    bound : largest decrease that the signatures allow, of one that was not fitted.
    parameters : of its effects.
    reason : why it could not be computed.
    """

    causes: Entries[str] = []
    effects: Entries[str] = []
    probability: float | None = None
    fitted: bool | None = None
    chi2: float | None = None
    decrease: float | None = None
    bound: float | None = None
    parameters: Parameters = {}
    reason: TextOf = ""


class ReportedCause(ReportPart):
    """A cause and the decision on it.

    Attributes
    ----------
    title : in words.
    decision : whether it is present, absent or undecided, or not testable with these data.
    probability : that it is present, alone or with others.
    forms : effect that is a form of it -> probability of the form.
    detectable : the smallest strength that these data would show, and ``parameter`` its name with the unit.
    detectable_share : the same as a share of the largest plausible strength; 1 or more cannot be detected.
    reason : why it is not testable.
    """

    title: TextOf = ""
    decision: Decision | None = None
    probability: float | None = None
    forms: TableOf[float] = {}
    parameter: str | None = None
    detectable: float | None = None
    detectable_share: float | None = None
    reason: TextOf = ""


class ReportedLackOfFit(ReportPart):
    """What smooth functions would explain of a residual: chi2 along ``free`` of them, and its p-value."""

    chi2: float | None = None
    free: int | None = None
    p: float | None = None


class NextExperiment(ReportPart):
    """A test that would settle what is open.

    Attributes
    ----------
    protocol : in words.
    separates, separation : the two most probable causes, and the squared distance of what they foretell over the noise and over
        what is not known of their parameters.
    information_bits : what it is expected to tell about which cause is right.
    minutes : that it takes, with its repeats.
    repeats : so many times the same.
    imposed, programme : the column that is imposed, and (time in s, its value) of each row.
    specimen, tool, conditions : of the test, as a dataset states them.
    """

    protocol: str | None = None
    separates: Entries[str] = []
    separation: float | None = None
    information_bits: float | None = None
    minutes: float | None = None
    repeats: int | None = None
    imposed: str | None = None
    programme: Entries[list[float]] = []
    specimen: dict[str, object] | None = None
    tool: dict[str, object] | None = None
    conditions: TableOf[object] = {}


class AssumedValue(ReportPart):
    """What follows if a quantity that the dataset assumes has another value.

    Attributes
    ----------
    message : why nothing could be computed.
    error_fit : mean error of the fitted curves, as a share of their largest value.
    """

    value: float | str | None = None
    verdict: Verdict | None = None
    message: str | None = None
    effects: Entries[str] = []
    parameters: Parameters = {}
    error_fit: float | None = None


class ReportedThreshold(ReportPart):
    """A number that decided something here, with its unit or the share of what it is."""

    value: float | None = None
    unit: TextOf = ""


class LoopReport(Document, ReportPart):
    """What ``report.json`` holds.

    Attributes
    ----------
    dataset, title : its name, and a sentence on it.
    unit : of the predicted quantity, for people.
    provenance : what has to be known to compute it again.
    remainder, remainder_where : what is left, and where most of it lives.
    sentence : the verdict in words; ``message`` says why a fit failed.
    effects : those that are missing; ``nearest`` are those of the final model where something else is missing as well.
    effect_titles : effect -> its name in words.
    undetermined : parameter of the final model's effects that the data do not determine -> why.
    strength_undetermined : effects that were found, but whose interval of the strength includes none at all.
    n_eff : number of independent data.
    groups : of the constants, where the program chose to fit each specimen by itself.
    baseline, final : the models before and after.
    discovered_law : what follows the data better where the final model leaves something unexplained.
    causes : cause -> the decision on it, the most probable first.
    hypotheses : sets of effects that were compared, the most probable first; ``compared`` and ``fitted`` count all of them.
    lack_of_fit : of the final model; ``discrepancy`` is the rms of its smooth residual as a share of the noise.
    posterior : cause -> its probability, the most probable first: "nothing", effects joined by " + ", or "other" for something
        that no effect does. Less than one in a thousand is left out.
    something_else : probability that something is at work that no effect does, alone or beside effects.
    sure : probability that the verdict is right; None where there is none, as in a search that was ``cut_off`` by a limit:
        what was never compared could be more probable.
    credible : sets of causes in words that hold 95 % together, of an ambiguous verdict.
    ambiguous_with : causes that are undecided.
    next_experiment, proposed_tests : the test that would settle best what is open, and it with the next best.
    sensitivity_to_assumed : assumed quantity -> what follows from other values of it.
    motion : of each curve and marker that moves, for recordings of markers; ``repeats`` where a test was repeated.
    thresholds : name -> a number that decides a verdict.
    files : what was written.
    """

    dataset: str | None = None
    title: str | None = None
    unit: str | None = None
    split: PartOf[ReportedSplit] = ReportedSplit()
    provenance: TableOf[object] = {}
    verdict: Verdict | None = None
    remainder: Remainder | None = None
    remainder_where: TextOf = ""
    sentence: TextOf = ""
    message: TextOf = ""
    effects: Entries[str] = []
    effect_titles: TableOf[str] = {}
    undetermined: TableOf[str] = {}
    strength_undetermined: Entries[str] = []
    nearest: Entries[str] = []
    n_eff: float | None = None
    noise: PartOf[NoiseAndFloors] = NoiseAndFloors()
    groups: ReportedGroups | None = None
    baseline: PartOf[ReportedModel] = ReportedModel()
    final: PartOf[ReportedModel] = ReportedModel()
    discovered_law: DiscoveredLawReport | None = None
    causes: TableOf[ReportedCause] = {}
    hypotheses: Entries[ReportedHypothesis] = []
    compared: int | None = None
    fitted: int | None = None
    lack_of_fit: ReportedLackOfFit | None = None
    discrepancy: float | None = None
    posterior: TableOf[float] = {}
    something_else: float | None = None
    sure: float | None = None
    cut_off: bool = False
    ambiguous_with: Entries[str] = []
    credible: Entries[str] = []
    next_experiment: NextExperiment | None = None
    proposed_tests: Entries[NextExperiment] = []
    sensitivity_to_assumed: TableOf[Entries[AssumedValue]] = {}
    motion: Entries[MarkerMotion] = []
    repeats: ReportedRepeats | None = None
    warnings: Entries[str] = []
    thresholds: TableOf[ReportedThreshold] = {}
    files: Entries[str] = []


@dataclass(frozen=True, eq=False)
class ReportCurve:
    """One curve of the report's charts, in the units of its axes.

    Columns may be given as lists. They become arrays with NaN where a number is missing, or None where no number is finite;
    ``measured`` is empty then.

    Attributes
    ----------
    x : (k,) what is imposed.
    measured, before, after : (k,) rows of the data, and what the baseline and the final model answer.
    sd : (k,) noise and numerics of a row, one standard deviation.
    """

    id: str = ""
    split: Side | None = None
    x_label: str = ""
    y_label: str = ""
    time_s: np.ndarray | None = None
    x: np.ndarray | None = None
    measured: np.ndarray = field(default_factory=lambda: np.zeros(0))
    before: np.ndarray | None = None
    after: np.ndarray | None = None
    sd: np.ndarray | None = None

    def __post_init__(self) -> None:
        for name in ("time_s", "x", "measured", "before", "after", "sd"):
            given = getattr(self, name)
            column = np.asarray([] if given is None else given, dtype=float)
            nothing = np.zeros(0) if name == "measured" else None
            object.__setattr__(self, name, column if np.isfinite(column).any() else nothing)
        for name in ("id", "x_label", "y_label"):
            object.__setattr__(self, name, str(getattr(self, name) or ""))

    @property
    def held_out(self) -> bool:
        """Whether the fit did not see it."""
        return self.split == "holdout"
