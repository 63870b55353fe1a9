"""The total interval of a constant, which includes what was assumed, and whether the constant can be used.

Each assumption that the dataset leaves open changes a constant by some amount in one direction. This change is its half width in
this direction, and independent half widths are added in squares to that of the fit (GUM 2008, JCGM 100, section 5.1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from explicitfe.inverse.identify.assumptions import change_unit
from explicitfe.inverse.identify.group_fit import GroupFit

# A modulus whose total interval reaches no farther than this share of it can be used; up to the second share with care.
USABLE_SHARE, ROUGH_SHARE = 0.1, 0.3


def total_interval(value: float, interval: Sequence[float], changes: np.ndarray) -> list[float]:
    """The 95 % interval of a value with the changes (n,) by other assumptions; it does not cross 0 if the interval does not."""
    low, high = interval
    down = float(np.hypot(value - low, np.linalg.norm(np.minimum(changes, 0.0))))
    up = float(np.hypot(high - value, np.linalg.norm(np.maximum(changes, 0.0))))
    return [max(value - down, 0.0) if low >= 0.0 else value - down, value + up]


def changes_of_constants(fitted: GroupFit) -> np.ndarray:
    """Changes (n, p) of the constants by the assumptions that the dataset leaves open."""
    open_ones = [h.change for h in fitted.hidden if h.left_open and h.change is not None]
    return np.reshape(open_ones, (-1, len(fitted.constants))) * change_unit(fitted.fit)


def headline(fitted: GroupFit, modulus: Sequence[float], constants: Mapping[str, Sequence[float]]) -> str:
    """Whether the shear modulus can be used, with its total interval and the largest part of that; and what is hardly known.

    Parameters
    ----------
    modulus, constants : total intervals of the initial shear modulus [Pa], and of the constants.
    """
    fit, (low, high) = fitted.fit, modulus
    value = fit.shear_modulus[0]
    if fitted.own.loss is not None:
        return "Do not use the constants: the law with them loses stability within the range of the data."
    if fit.undetermined:
        return f"Do not use the constants: the data do not determine {', '.join(fit.undetermined)}."
    share = max(value - low, high - value) / value
    verdict = "can be used" if share <= USABLE_SHARE else "is an estimate" if share <= ROUGH_SHARE else "is not known well enough"
    if not np.isfinite(share):
        return "Do not use the constants: the data give no limit for the shear modulus."
    alone = fit.shear_modulus_interval
    parts = {"the fit": max(value - alone[0], alone[1] - value)}
    changes = changes_of_constants(fitted) @ fit.law.shear_modulus_gradient()
    names = [h.name for h in fitted.hidden if h.left_open and h.change is not None]
    parts |= {name: abs(float(change)) for name, change in zip(names, changes, strict=True)}
    largest = max(parts, key=lambda name: parts[name])
    cause = "the misfit and noise of the data" if largest == "the fit" else f"what is assumed ({largest} would change it most)"
    pairs = zip(constants.items(), map(float, fit.constants), strict=True)
    rough = [name.removesuffix("_Pa") for (name, (a, b)), c in pairs if max(c - a, b - c) > ROUGH_SHARE * abs(c)]
    others = f" Known to no better than {100.0 * ROUGH_SHARE:.0f} %: {', '.join(rough)}." if rough else ""
    return (
        f"The shear modulus {verdict}: {value:.4g} Pa, {low:.4g} to {high:.4g} Pa (95 %, with what was assumed). Most of this is "
        f"{cause}.{others}"
    )
