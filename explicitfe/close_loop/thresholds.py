"""All numbers that decide a verdict, or what is said about it, each with its unit and the reason for its value.

They are stored in ``report.json``, and docs/reference/close-loop.md prints them. Numbers that only steer a computation, such as
steps of derivatives, stay beside the code that uses them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import TypeVar

Number = TypeVar("Number", int, float)


def threshold(value: Number, unit: str, reason: str) -> Number:
    """An entry of the table."""
    return field(default=value, metadata={"unit": unit, "reason": reason})


@dataclass(frozen=True)
class Thresholds:
    """The table; :func:`entries` gives unit and reason of each entry."""

    # ---- what is noise ----
    stated_noise_factor: float = threshold(
        1.6,
        "times the stated noise",
        "Rows that differ by more than this are rougher than the dataset says, and their noise is estimated instead. "
        "Thirty rows that have the stated noise look rougher than this in one case of a hundred.",
    )
    smooth_degree: int = threshold(
        5,
        "degree of the polynomial between two bends",
        "Physics is smooth between the bends of a programme. This degree follows a ramp or a relaxation, but not the noise.",
    )
    smooth_rows_per_term: int = threshold(
        4,
        "rows per coefficient",
        "With fewer rows for each coefficient the smooth curve would follow the noise of a short piece.",
    )
    likelihood_margin: float = threshold(
        1.0,
        "-2 log likelihood",
        "One standard deviation: of all correlations and scatters this near to the best, the largest is taken. "
        "If noise is taken for smaller than it is, the rest of it is taken for physics.",
    )
    unknown_noise_share: float = threshold(
        0.01,
        "share of a curve's largest value",
        "Where noise is not stated and the programme bends at every row, nothing shows it. Load cells and pictures of curves are "
        "seldom worse.",
    )
    loose_tool_noise_factor: float = threshold(
        3.0,
        "times the noise of an imposed force",
        "At no more force than this the tool may hang in the air, and such a row says nothing of the displacement. Noise "
        "exceeds it in one row of a thousand.",
    )
    trend_repeats: int = threshold(
        3, "repeats of one specimen", "A trend has two numbers, so only a third repeat can tell it from scatter."
    )
    equal_programme_share: float = threshold(
        0.05, "share of a programme's range", "A machine repeats its programme better than this, and planned steps are larger."
    )
    equal_length_share: float = threshold(
        0.1, "share of a length", "Specimens that are cut to one size differ by less, and specimens of two sizes by more."
    )
    specimen_spread: float = threshold(
        0.2,
        "standard deviation of the log of stiffness",
        "Specimens that differ by less are served by one set of constants and a scatter of tests. Beyond it one specimen in "
        "three is off by more than a fifth, which is no small change of scale any more.",
    )
    assumed_length_error_share: float = threshold(
        0.1,
        "share of an assumed length, one standard deviation",
        "A length that the source does not state is inferred from pictures or from similar tests, no better than this.",
    )
    stated_length_error_share: float = threshold(
        0.003,
        "share of a stated length, one standard deviation",
        "A length is stated because it was measured: a calliper or a mould gives 0.05 mm in twenty.",
    )
    unforeseen_numerics_factor: float = threshold(
        2.0,
        "times what mesh and element change together and neither alone",
        "Such errors are smooth in time, so they weigh more than noise of equal size. Trajectories only.",
    )

    # ---- what the data can show ----
    hold_share: float = threshold(0.1, "share of a test's duration", "A shorter stop is the turn of a machine and not a hold.")
    rate_ratio: float = threshold(1.5, "ratio of two rates", "Rates that are nearer to each other hardly tell time from strain.")
    unloading_share: float = threshold(
        0.05, "share of a programme's range", "A shorter return is the play of a machine and not unloading."
    )
    pull_share: float = threshold(
        0.01, "share of the largest force", "A force that is less negative may be the zero of the load cell and not a pull."
    )
    imitation_sine: float = threshold(
        0.3,
        "sine of the angle to what the constants can do",
        "What is left of a smooth function at a smaller angle is mostly the noise of the imposed column in their derivatives.",
    )
    visible_separation: float = threshold(
        25.0,
        "squared distance of two answers over the covariance",
        "Five standard deviations. An effect whose largest plausible strength stays below cannot be tested, and a planned test "
        "tells two models apart if it separates them by more.",
    )

    # ---- what is significant ----
    significance_p: float = threshold(
        0.01,
        "p-value",
        "One false alarm in a hundred datasets without an effect, after Holm's correction for the number of candidates.",
    )
    quiet_p: float = threshold(
        0.2,
        "p-value of the lack of fit",
        "Where each run costs seconds, candidates are not tried on a residual of which no smooth curve would explain anything; "
        "beside the baseline those are that take one ramp, and not a whole history. Of effects with a separation of 25 one in "
        "twenty leaves so quiet a residual of thirty directions.",
    )
    gross_misfit: float = threshold(
        9.0,
        "mean square of the residual over the noise of the rows",
        "Three standard deviations everywhere. Against such a misfit the scatter of tests and errors of assumed lengths would "
        "be spent on it and the constants would go anywhere, so the model is fitted by the rows alone.",
    )

    # ---- which candidates are fitted ----
    refitted_candidates: int = threshold(
        8, "candidates in a round", "A bound on the time: each costs some runs of a homogeneous state."
    )
    refitted_candidates_on_a_mesh: int = threshold(
        3, "candidates in a round", "A bound on the time: each costs tens of runs of a mesh."
    )
    refit_share_of_best_drop: float = threshold(
        0.25, "share of the best drop of chi2", "A fit finds more than the best trial, but not several times as much."
    )
    mesh_refit_share_of_best_drop: float = threshold(
        0.6,
        "share of the best drop of chi2",
        "A candidate that needs a mesh where the model needs none costs more than all others together, so it must promise more.",
    )
    dear_refit_share_of_best_drop: float = threshold(
        0.95,
        "share of the best drop of chi2",
        "A candidate that follows whole histories on a mesh is fitted if its trial leaves no more than 25 above the best fit, or "
        "gains nearly as much as the best trial: trials are linear in the strength, which is right to some per cent.",
    )
    near_best_drop: float = threshold(
        60.0, "chi2", "Candidates this near to the best drop are fitted too, because they may be mistaken for it."
    )
    refit_gain_over_trial: float = threshold(
        1.5,
        "times the drop of the best trial",
        "A candidate on a mesh is not fitted if even this gain would leave it far from the best one.",
    )

    # ---- which of them is chosen ----
    far_misfit: float = threshold(
        150.0,
        "chi2",
        "A model that fits the data this much worse than the best one is told apart, and no further run has to show it.",
    )
    told_apart_separation: float = threshold(
        16.0,
        "squared distance of two answers over the covariance",
        "Models that are nearer cannot be told apart by these data. The covariance is cautious, so this is less than what a plan "
        "asks for: of 309 cases for tuning it decided 11 more than 25 would have, all of them rightly.",
    )
    excluded_chi2: float = threshold(
        10.0,
        "chi2",
        "Odds of 150 to 1 for the better of two models with as many parameters. A rival that fits so much worse than a model "
        "that leaves nothing unexplained is excluded, however near the answers of the two lie.",
    )
    cross_validated_tests: int = threshold(
        3, "tests that are left out in turn", "Of two rates one does not say what the other will be, so fewer speak for no model."
    )
    noticed_gain: float = threshold(
        4.0,
        "chi2 of left-out tests",
        "The least gain that is of consequence. An effect that changes left-out tests by two standard deviations gains this "
        "much, and the gain of a smaller one is less than its own error. It is also an odds ratio of 7.",
    )
    cross_validation_gain_share: float = threshold(
        0.02,
        "share of the cross-validated error",
        "Far above the noise everything is significant. There a further effect has to lower the error of left-out tests by this.",
    )
    unexplained_excess_share: float = threshold(
        0.0625,
        "share of the excess of chi2 over noise",
        "A quarter of what is missing in size. Effects that leave more help, but they are not what is missing: a law that none "
        "of them describes is imitated by two or three to a half or a tenth, while what is left by the right effect is noise or "
        "its form. Less than a visible separation is not counted.",
    )
    alike_gain_share: float = threshold(
        0.5,
        "share of the gain in chi2 of the best model with one effect more",
        "Beside an unexplained remainder nothing speaks for one of the models that gain about as much: intervals of the "
        "constants hold those of all of them.",
    )

    form_excess_share: float = threshold(
        0.0625,
        "share of the excess of chi2 over noise",
        "A quarter of what is missing in size. Where an effect that remembers was found, a second one that explains less may be "
        "the form of the first: relaxation, set and softening of a tissue follow no formula more exactly.",
    )

    # ---- how sure a verdict is ----
    discrepancy_odds: float = threshold(
        0.1, "odds", "Before the data, that something is at work that no effect does: about what real datasets have shown."
    )
    unforeseen_probability: float = threshold(
        0.05, "probability", "Left to causes that neither the effects nor a smooth discrepancy describe, however clear the data."
    )

    nothing_probability: float = threshold(
        0.3,
        "probability",
        "A verdict that something is missing is not given where nothing is missing with a larger probability: an alarm on a good "
        "model is worse than a missed effect. Of 118 cases for tuning it changed one, an effect that the data hardly show.",
    )
    finding_probability: float = threshold(
        0.5,
        "probability",
        "An effect is not said to be found where something else is more probable than this, and it less.",
    )
    surviving_probability: float = threshold(
        0.005, "probability", "Causes that are less probable do not compete where the next test is chosen."
    )
    sure_enough: float = threshold(
        0.5,
        "probability",
        "Where each answer is the run of a mesh, no test is proposed beside a verdict that nothing is missing or that an effect "
        "was found, if it is surer than this: the runs of all proposals would take minutes.",
    )
    settling_share: float = threshold(
        0.7,
        "share of the largest expected information",
        "Of tests that are expected to tell at least so much the one that tells most in a minute is proposed.",
    )
    worthwhile_information: float = threshold(
        0.05, "share of the entropy of the causes", "A test that is expected to tell less of what is open is not proposed."
    )

    # ---- which curves are held out ----
    held_out_share: float = threshold(1.0 / 3.0, "share of the tests", "Enough to check a prediction, and most are left to fit.")
    fitted_curves_under_a_tool: int = threshold(6, "curves", "A bound on the time: each costs seconds for every model.")

    # ---- what is said ----
    few_data: float = threshold(10.0, "independent rows", "Fewer show only what is very strong, and the report warns of it.")
    missed_factor: float = threshold(
        2.0, "times the worst error of a fitted curve", "A held-out curve with a larger error is said to be missed."
    )
    numerical_share_of_noise: float = threshold(
        0.5, "share of the noise", "Numerics that change the answer by more are named in the warnings as a floor."
    )
    numerics_bound_share: float = threshold(
        1.0 / 3.0,
        "share of the noise",
        "Where the bound of all numerical errors is larger, what it explains is no proof that nothing is missing. "
        "A smaller one adds less than 6 % to the noise of a row.",
    )
    concentrated_factor: float = threshold(
        1.5, "times the mean square", "A part of the data with a larger misfit is named as where the remainder lives."
    )
    smallest_part_share: float = threshold(
        0.05, "share of the rows", "A part is not named if it is smaller, or if it is all but so small a part."
    )
    early_share: float = threshold(0.2, "share of a test's duration", "The first fifth of a test is called early, the last late.")
    low_load_share: float = threshold(
        0.25, "share of the largest load", "The lowest quarter of the load is called low, the highest quarter high."
    )
    assumed_variation_share: float = threshold(
        0.1,
        "share of an assumed length",
        "The report repeats the fits with the length smaller and larger by its likely error, the one that the covariance has.",
    )


THRESHOLDS = Thresholds()


def entries() -> list[tuple[str, float, str, str]]:
    """Name, value, unit and reason of each threshold."""
    return [(f.name, getattr(THRESHOLDS, f.name), f.metadata["unit"], f.metadata["reason"]) for f in fields(THRESHOLDS)]


def markdown_table() -> str:
    """The table of docs/reference/close-loop.md."""
    rows = [f"| `{name}` | {value:.3g} | {unit} | {reason} |" for name, value, unit, reason in entries()]
    return "\n".join(["| threshold | value | unit | why |", "|---|---|---|---|", *rows]) + "\n"
