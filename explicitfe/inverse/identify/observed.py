"""Rows of a curve with the model that predicts them, and the contact that fits them best."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from explicitfe.inverse.identify.forward import CurveModel
from explicitfe.inverse.identify.laws import ConstantsLike

# The contact is final when a step is less than this share of the range, or after so many steps.
CONTACT_TOLERANCE, MOST_CONTACT_STEPS = 1e-9, 60


@dataclass(frozen=True)
class Observed:
    """Rows of one curve that are fitted or predicted.

    Attributes
    ----------
    id : of the curve.
    imposed, measured : (k,) SI.
    imposed_sd, measured_sd : noise of one row; None where it is unknown.
    model : it predicts ``measured`` from ``imposed``.
    contact_m : where a search for the displacement of first contact begins; None if contact is at 0.
    """

    id: str
    imposed: np.ndarray
    measured: np.ndarray
    imposed_sd: float | None
    measured_sd: float | None
    model: CurveModel
    contact_m: float | None = None

    @property
    def noise_known(self) -> bool:
        """Whether the dataset states a noise other than zero."""
        return (self.imposed_sd or 0.0) > 0.0 or (self.measured_sd or 0.0) > 0.0

    def predicted(self, constants: ConstantsLike) -> np.ndarray:
        """Prediction of the model (k,), with the contact that fits it best."""
        if self.contact_m is None:
            return self.model(self.imposed, *map(float, constants))
        contact = self.contact(constants)
        return self.at_contact(contact).predicted(constants) + contact * self.model.by_force

    def at_contact(self, contact_m: float) -> Observed:
        """The same rows with the displacement zero at a given contact."""
        if self.model.by_force:
            return replace(self, measured=self.measured - contact_m, contact_m=None)
        return replace(self, imposed=self.imposed - contact_m, contact_m=None)

    def contact(self, constants: ConstantsLike) -> float:
        """Displacement of first contact with the smallest sum of squares [m]; 0 where it is not fitted.

        The residual is thereby a function of the constants only (variable projection, Golub & Pereyra 1973), and its curvature
        and profiles include the error of the contact.
        """
        if self.contact_m is None:
            return 0.0
        if self.model.by_force:
            return float(np.mean(self.measured - self.at_contact(0.0).predicted(constants)))
        contact, step, squares = self.contact_m, 0.0, np.inf
        for _ in range(MOST_CONTACT_STEPS):
            value, slope = self.model.with_slope(self.imposed - contact - step, *map(float, constants))
            residual = value - self.measured
            if float(residual @ residual) > squares:  # too far
                step *= 0.5
            else:
                contact, squares = contact + step, float(residual @ residual)
                touching = np.where(self.imposed > contact, slope, 0.0)
                step = float(touching @ residual) / max(float(touching @ touching), 1e-300)
            if abs(step) < CONTACT_TOLERANCE * float(np.ptp(self.imposed)):
                break
        return contact

    def contact_slope(self, imposed: np.ndarray, constants: ConstantsLike) -> np.ndarray:
        """Change of the predicted column (k,) with the displacement of contact, but for its sign."""
        if self.model.by_force:
            return np.ones(len(imposed))
        return np.where(imposed > 0.0, self.model.with_slope(imposed, *map(float, constants))[1], 0.0)

    def sd(self, constants: ConstantsLike) -> np.ndarray:
        """Standard deviation of measured - predicted (k,), including the error of the imposed column."""
        imposed = self.at_contact(self.contact(constants)).imposed
        slope = self.model.with_slope(imposed, *map(float, constants))[1]
        return np.hypot(self.measured_sd or 0.0, slope * (self.imposed_sd or 0.0))

    def errors(self, constants: ConstantsLike) -> dict[str, float]:
        """Rms error in the unit of the measured column, and over its largest magnitude; the largest deviation."""
        residual = self.predicted(constants) - self.measured
        rmse = float(np.sqrt(np.mean(residual**2)))
        return {
            "rmse": rmse,
            "nrmse": rmse / float(np.abs(self.measured).max()),
            "largest": float(np.abs(residual).max()),
        }

    def rows(self, chosen: np.ndarray) -> Observed:
        """The rows that a mask (k,) chooses."""
        return replace(self, imposed=self.imposed[chosen], measured=self.measured[chosen])
