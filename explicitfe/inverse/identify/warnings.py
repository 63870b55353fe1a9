"""Warnings of an identification, in sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from explicitfe.fem.materials.stability import STRETCHES_IN_USE, loss_of_stability
from explicitfe.inverse.identify.assumptions import sentence
from explicitfe.inverse.identify.fit import contact_interval
from explicitfe.inverse.identify.forward import UniformResponse
from explicitfe.inverse.identify.group_fit import GroupFit
from explicitfe.inverse.identify.laws import ALL
from explicitfe.inverse.identify.observed import Observed
from explicitfe.inverse.measured.contact import about_contact
from explicitfe.inverse.measured.curve import PRINTED_UNITS, Curve, SpecimenDataset
from explicitfe.inverse.measured.select import Group

# Numerical noise above this share of the data's noise leads to a warning.
NUMERICAL_NOISE_SHARE = 0.5
# At this compression the free sides of an incompressible solid between platens become unstable (Biot 1963).
BUCKLING_COMPRESSION = 0.56
# A law with more chi2 per degree of freedom does not describe the data: its residual is twice the noise.
MISFIT_CHI2_RATIO = 4.0
# Another law is preferred if its AICc is lower by more than this (Burnham & Anderson 2002, section 2.6).
PREFERRED_AICC = 10.0
# A first value above this share of the largest one was measured before the test began: the sensor has an offset.
OFFSET_SHARE = 0.01
# The tool is at zero if it is nearer to it than this.
ZERO_DISPLACEMENT_M = 1e-9


def group_warnings(fitted: GroupFit) -> list[str]:
    """Everything that a reader must know before using the constants of a group."""
    unit, scale = fitted.unit, fitted.scale
    warnings = _about_law(fitted) if fitted.paper is None else []
    for name in fitted.at_bound:
        symbol = name.removesuffix("_Pa")
        reason = "the data stiffen less than any such law" if symbol == "C20" else "the data do not need this term"
        warnings.append(f"{symbol} is at its bound 0: {reason}, and the interval is one-sided.")
    undetermined = [name.removesuffix("_Pa") for name in fitted.fit.undetermined]
    if undetermined:
        warnings.append(f"The data do not determine {', '.join(undetermined)}: use a law with fewer constants.")
    warnings += _about_residuals(fitted)
    if fitted.numerical_sd > NUMERICAL_NOISE_SHARE * fitted.noise_sd and not fitted.fit.noise_estimated:
        warnings.append(
            f"Numerical noise ({fitted.numerical_sd:.2g} {unit}) is not small compared with the noise of the data "
            f"({fitted.noise_sd:.2g} {unit}): use a larger --refinement."
        )
    warnings += _about_curves(fitted)
    about_hidden = sentence(fitted.hidden, {"mm": "µm"}.get(unit, unit), scale * (1e3 if unit == "mm" else 1.0))
    return warnings + ([about_hidden] if about_hidden else [])


def _about_law(fitted: GroupFit) -> list[str]:
    """Warnings about the law: a preferred one, its misfit, its stability."""
    fit, own, preferred, test = fitted.fit, fitted.own, fitted.preferred, fitted.range_test
    warnings = []
    if len(fitted.laws) == 1:
        warnings.append(f"Only the law {own.law.name} was fitted; --law {ALL} compares the laws.")
    elif own.aicc - preferred.aicc > PREFERRED_AICC and preferred.fit is not None:
        lower = own.aicc - preferred.aicc
        text = f"The data support the law {preferred.law.name} more than {own.law.name}: its AICc is lower by {lower:.0f}"
        if own.held_out is not None and preferred.held_out is not None:
            text += f", its held-out error is {100.0 * preferred.held_out:.2g} % instead of {100.0 * own.held_out:.2g} %"
        modulus, other = fit.shear_modulus[0], preferred.fit.shear_modulus[0]
        warnings.append(f"{text}, and its shear modulus {other:.5g} Pa instead of {modulus:.5g} Pa.")
    if test is not None and test.significant:
        warnings.append(
            f"The law {own.law.name} does not describe the whole range: fitted to the lower half, the shear modulus is "
            f"{test.shear_modulus_Pa:.5g} Pa instead of {fit.shear_modulus[0]:.5g} Pa."
        )
    if fit.widening.model_form > 1.0:
        warnings.append(
            f"The 95 % intervals include the model error, which widens them by a factor of {_times(fit.widening.model_form)}."
        )
    if own.loss is not None:
        warnings.append(
            f"The law {own.law.name} with these constants loses stability at a stretch of {own.loss.stretch:.3g} in "
            f"{own.loss.load}, within the range of the data: do not use the constants."
        )
    elif (loss := loss_of_stability(fit.law.at(fit.constants, 0.499))) is not None:
        low, high = STRETCHES_IN_USE
        warnings.append(
            f"The law {own.law.name} with these constants loses stability at a stretch of {loss.stretch:.3g} in {loss.load}, "
            f"outside the data; simulations refuse them, since they require stability from {low:g} to {high:g}."
        )
    if not fit.law.in_elements and fitted.group.fitted[0].tool is not None:
        warnings.append(
            f"Elements do not support the law {own.law.name}: the assumptions on the test were not varied, and no scenario was "
            "written."
        )
    return warnings


def _about_residuals(fitted: GroupFit) -> list[str]:
    """Warnings about the size of the residuals, and about their correlation."""
    fit = fitted.fit
    warnings = []
    if fit.noise_estimated:
        warnings.append(
            "The dataset does not state the noise of all curves: it is estimated from the residual, which includes misfit."
        )
    elif fitted.chi2 is not None and fit.free > 0 and fit.chi2 > MISFIT_CHI2_RATIO * fit.free:
        share = np.sqrt(fit.chi2 / fit.free)
        warnings.append(f"The residual is {share:.1f} times the noise: the law does not describe these data.")
    widening = fit.widening
    if widening.correlation:
        warnings.append(
            f"Neighbouring residuals are correlated ({widening.correlation:.2f}): {widening.rows} rows count as about "
            f"{widening.effective:.0f}."
        )
    if widening.of_residual > 1.0 and fitted.paper is None:
        warnings.append(
            f"The 95 % intervals are {_times(widening.of_residual)} times wider than from independent noise alone, because the "
            "residual is correlated or larger than the noise."
        )
    return warnings


def _about_curves(fitted: GroupFit) -> list[str]:
    """Warnings about single curves: offsets, buckling sides, rows that are not fitted."""
    pairs = list(zip(fitted.group.fitted, fitted.observed, strict=True))
    warnings = []
    units = [PRINTED_UNITS[curve.predicted] for curve, _ in pairs]
    values = [f"{curve.id} {scale * o.measured[0]:.3g} {unit}" for (curve, o), (unit, scale) in zip(pairs, units, strict=True)]
    offsets = [value for value, (curve, o) in zip(values, pairs, strict=True) if _has_offset(curve, o)]
    if offsets:
        warnings.append(f"The first row is not zero and the law has no offset: {', '.join(offsets)}.")
    for number, (curve, o) in enumerate(pairs):
        if o.contact_m is None:
            warnings += [f"{note[0].upper()}{note[1:]}"] if (note := about_contact(curve)) else []
            continue
        contact, half = contact_interval(o, fitted.fit, number)
        rows = int((curve.displacement_m[: len(o.measured)] < contact).sum())
        warnings.append(
            f"{curve.id} comes into contact at {1e3 * contact:.3g} ± {1e3 * half:.2g} mm (95 %), which was fitted with the "
            f"constants: {rows} rows are not in contact."
        )
    buckled = [curve.id for curve, o in pairs if _buckles(curve, o)]
    if buckled:
        warnings.append(
            f"Below a stretch of {1.0 - BUCKLING_COMPRESSION:.2f} the sides of a simulated specimen buckle (Biot's surface "
            f"instability); the fit assumes that they stay straight: {', '.join(buckled)}."
        )
    pairs += zip(fitted.group.predicted, fitted.predicted, strict=True)
    lost = sum(len(curve.time_s) - len(o.measured) for curve, o in pairs)
    if lost:
        warnings.append(
            f"An elastic law cannot describe hysteresis; only the loading branch was fitted. {lost} rows of hold and unloading "
            "were not used, and the constants and their intervals refer to loading."
        )
    return warnings


def _times(factor: float) -> str:
    return f"{factor:.{0 if factor >= 10.0 else 1}f}"


def _has_offset(curve: Curve, observed: Observed) -> bool:
    if curve.tool is None or observed.contact_m is not None or abs(observed.imposed[0]) >= ZERO_DISPLACEMENT_M:
        return False
    return bool(abs(observed.measured[0]) > OFFSET_SHARE * np.abs(observed.measured).max())


def _buckles(curve: Curve, observed: Observed) -> bool:
    response = observed.model.response
    return isinstance(response, UniformResponse) and curve.displacement_m.max() > BUCKLING_COMPRESSION * response.height_m


def dataset_warnings(
    dataset: SpecimenDataset, groups: Sequence[Group], left_out: Mapping[str, str], failures: Mapping[str, str]
) -> list[str]:
    """Everything that a reader must know about the dataset as a whole."""
    warnings = [f'Curve "{name}" was not used: {why}.' for name, why in left_out.items()]
    if not any(group.predicted for group in groups):
        warnings.append("All curves were fitted: no held-out curve tests the prediction.")
    warnings += [f'Constants "{name}" failed: {message}' for name, message in failures.items()]
    return warnings
