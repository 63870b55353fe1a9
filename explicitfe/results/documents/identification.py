"""``identify.json``, the answer of ``explicitfe identify``, by groups of constants; see docs/reference/identify.md."""

from __future__ import annotations

from typing import Literal, NotRequired

from typing_extensions import TypedDict

from explicitfe.results.documents.document import Computed


class IdentifiedConstant(TypedDict):
    """A constant, in Pa if its name ends so; the paper's method has no intervals.

    Attributes
    ----------
    sd : standard error from independent noise alone.
    total95 : the interval to quote: ``ci95`` with the changes by what was assumed.
    ci95 : from the data, widened for correlated residuals, misfit and model-form error; its ends may be infinite.
    ci95_of_noise, ci95_curvature : from independent noise alone, by the profile likelihood and by the curvature at the optimum.
    """

    value: float
    sd: NotRequired[float]
    total95: NotRequired[list[Computed]]
    ci95: NotRequired[list[Computed]]
    ci95_of_noise: NotRequired[list[Computed]]
    ci95_curvature: NotRequired[list[Computed]]


class IdentifiedModulus(TypedDict):
    """A small-strain modulus [Pa] with its 95 % intervals, as wide as those of the constants."""

    value: float
    total95: NotRequired[list[Computed]]
    ci95: NotRequired[list[Computed]]


class LawMisfit(TypedDict):
    """Misfit of the fitted law.

    Attributes
    ----------
    rms : of the residual, in the unit of the group.
    nrmse : the same over the largest measured value of the curve.
    reduced_chi2 : chi2 per degree of freedom; None where the noise was estimated from the residual.
    model_form : factor of the intervals for the model-form error, which ``widened_by`` includes.
    lower_half_shear_modulus_Pa : shear modulus from the lower half of the range; None where it has too few rows.
    depends_on_range : whether this differs significantly from that of the whole range.
    """

    rms: float
    nrmse: float
    reduced_chi2: float | None
    model_form: float
    lower_half_shear_modulus_Pa: float | None
    depends_on_range: bool


class ComparedLaw(TypedDict):
    """A law in the comparison; where there is a ``problem`` there are no numbers.

    Attributes
    ----------
    nrmse, held_out_nrmse : rms error over the largest value, of the fitted and of held-out rows.
    aicc_difference, bic_difference : to the lowest one among the compared laws.
    weight : Akaike weight.
    unstable_at_stretch : where the law loses stability within the range of the data; None for a stable law.
    """

    law: str
    problem: NotRequired[str]
    constants: NotRequired[dict[str, float]]
    shear_modulus_Pa: NotRequired[float]
    nrmse: NotRequired[float]
    reduced_chi2: NotRequired[float | None]
    held_out_nrmse: NotRequired[float | None]
    aicc_difference: NotRequired[float]
    bic_difference: NotRequired[float]
    weight: NotRequired[float]
    unstable_at_stretch: NotRequired[float | None]


class IdentifiedCurve(TypedDict):
    """Errors of one curve; all but ``nrmse``, a share of the largest measured value, are in the curve's unit.

    Attributes
    ----------
    contact_mm, contact_ci95_mm : fitted displacement of first contact, with its 95 % interval.
    rows_before_contact : rows with a smaller displacement.
    """

    split: Literal["fit", "holdout"]
    unit: str
    rows: int
    rows_left_out: int
    rmse: float
    nrmse: float
    largest_error: float
    first_value: float
    contact_mm: NotRequired[float]
    contact_ci95_mm: NotRequired[list[Computed]]
    rows_before_contact: NotRequired[int]


class MeanErrors(TypedDict):
    """Errors averaged over curves."""

    nrmse: float
    rmse: float


# An alternative to an assumption, named by the key "if", and its effect on the fit: relative changes of the constants, and the
# residual that they cannot compensate; or the problem for which there are no numbers. The total intervals include those that the
# dataset leaves open.
HiddenRow = TypedDict(
    "HiddenRow",
    {
        "if": str,
        "left_open": bool,
        "problem": NotRequired[str],
        "C10_change": NotRequired[float],
        "C20_change": NotRequired[float],
        "C30_change": NotRequired[float],
        "C01_change": NotRequired[float],
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
    headline : whether the constants can be used; not of the paper's method.
    law : the law of the constants.
    shear_modulus, youngs_modulus : at small strain.
    misfit : of this law.
    laws : all laws that were compared, in the order in which they were fitted.
    undetermined : constants that the data do not determine.
    chi2 : None where the noise was estimated from the residual.
    widened_by : width of the intervals over that from independent noise alone.
    noise_sd, numerical_sd : rms of a row's noise, and of the numerical noise, in the unit.
    interpolation_error : deviation of the interpolated response from a simulator run, relative to the force.
    error : side -> mean errors, None where it has no curve.
    hides : sensitivity of the constants to the assumptions.
    paper : of the paper's method only.
    """

    status: str
    warnings: NotRequired[list[str]]
    message: NotRequired[str]
    headline: NotRequired[str]
    law: NotRequired[str]
    constants: NotRequired[dict[str, IdentifiedConstant]]
    shear_modulus: NotRequired[IdentifiedModulus]
    youngs_modulus: NotRequired[IdentifiedModulus]
    misfit: NotRequired[LawMisfit]
    laws: NotRequired[list[ComparedLaw]]
    undetermined: NotRequired[list[str]]
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
    """Contents of ``identify.json``.

    Attributes
    ----------
    law : as requested; each group names the law of its constants.
    groups : name -> curves that share their constants.
    left_out : curve -> reason why it is neither fitted nor predicted.
    forward_runs : number of simulator runs.
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
