"""``identify.json``: what ``explicitfe identify`` writes, group of constants after group; see docs/reference/identify.md."""

from __future__ import annotations

from typing import Literal, NotRequired

from typing_extensions import TypedDict

from explicitfe.results.document import Computed


class IdentifiedConstant(TypedDict):
    """A constant [Pa]; the paper's method has no intervals.

    Attributes
    ----------
    sd : standard error from independent noise alone.
    ci95 : the interval to quote, from the profile likelihood, as wide as the residual asks for; its end may be infinite.
    ci95_of_noise, ci95_curvature : from independent noise alone, by the profile likelihood and by the curvature at the optimum.
    """

    value: float
    sd: NotRequired[float]
    ci95: NotRequired[list[Computed]]
    ci95_of_noise: NotRequired[list[Computed]]
    ci95_curvature: NotRequired[list[Computed]]


class IdentifiedCurve(TypedDict):
    """Errors of one curve; all but ``nrmse``, a share of the largest measured value, are in the curve's unit."""

    split: Literal["fit", "holdout"]
    unit: str
    rows: int
    rows_left_out: int
    rmse: float
    nrmse: float
    largest_error: float
    first_value: float


class MeanErrors(TypedDict):
    """Errors averaged over curves."""

    nrmse: float
    rmse: float


# One alternative to what was supposed, named by the key "if", and what it would do to the fit: relative changes of the constants,
# and the residual that they cannot take up; or the problem for which there are no numbers.
HiddenRow = TypedDict(
    "HiddenRow",
    {
        "if": str,
        "problem": NotRequired[str],
        "C10_change": NotRequired[float],
        "C20_change": NotRequired[float],
        "left": NotRequired[float],
        "left_in_noise": NotRequired[float],
    },
)


class PaperRun(TypedDict):
    """One forward run of the paper's method."""

    C10_Pa: float
    C20_Pa: float
    changed: str
    displacements_mm: list[float]


class PaperRows(TypedDict):
    """The paper's method: its tolerances, the loads, and its runs."""

    alpha_mm: float
    beta_mm: float
    tolerance: str
    loads_N: list[float]
    measured_mm: list[float]
    errors_mm: list[float]
    within: list[bool]
    largest_relative_error: float
    trace: list[PaperRun]


class IdentifiedGroup(TypedDict):
    """Curves that share their constants; where the status is "failed" there is a message and no constants.

    Attributes
    ----------
    chi2 : None where the noise was estimated from the residual.
    widened_by : how many times as wide the intervals are as from independent noise alone.
    noise_sd, numerical_sd : rms of a row's noise, and of the numerical noise, in the unit.
    interpolation_error : how far the interpolated response was from a run of the simulator, relative to the force.
    error : side -> mean errors, None where it has no curve.
    hides : what the fit hides.
    paper : of the paper's method only.
    """

    status: str
    warnings: NotRequired[list[str]]
    message: NotRequired[str]
    constants: NotRequired[dict[str, IdentifiedConstant]]
    correlation: NotRequired[float | None]
    at_bound: NotRequired[list[str]]
    chi2: NotRequired[float | None]
    degrees_of_freedom: NotRequired[int]
    rows: NotRequired[int]
    noise: NotRequired[str]
    widened_by: NotRequired[float]
    noise_sd: NotRequired[float]
    numerical_sd: NotRequired[float]
    interpolation_error: NotRequired[float]
    unit: NotRequired[str]
    error: NotRequired[dict[str, MeanErrors | None]]
    curves: NotRequired[dict[str, IdentifiedCurve]]
    assumed: NotRequired[list[str]]
    hides: NotRequired[list[HiddenRow]]
    paper: NotRequired[PaperRows]


class Identification(TypedDict):
    """What ``identify.json`` holds.

    Attributes
    ----------
    groups : name -> curves that share their constants.
    left_out : curve -> why it is neither fitted nor predicted.
    forward_runs : runs of the simulator.
    """

    dataset: str
    title: str
    path: str
    test: str
    method: str
    law: str
    poisson: float
    refinement: float
    groups: dict[str, IdentifiedGroup]
    left_out: dict[str, str]
    forward_runs: int
    warnings: list[str]
    wall_s: float
    files: list[str]
