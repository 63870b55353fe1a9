"""Answer of ``explicitfe verify``."""

from __future__ import annotations

from typing_extensions import TypedDict


class VerifiedClaim(TypedDict):
    """A claim, computed on this machine.

    Attributes
    ----------
    evidence : closed form, other program, published, measured data, or own data.
    measured, reference : computed figures and reference as texts.
    off, allowed, unit : deviation and permitted deviation; ``off`` is None if the claim could not be computed.
    fails : limits of the claim.
    message : why the claim could not be computed; otherwise "".
    """

    name: str
    claim: str
    evidence: str
    measured: str
    reference: str
    source: str
    off: float | None
    allowed: float
    unit: str
    holds: bool
    fails: str
    message: str
    seconds: float


class Verification(TypedDict):
    """All requested claims.

    Attributes
    ----------
    holding : number of claims that hold.
    version : version of explicitfe.
    """

    version: str | None
    claims: list[VerifiedClaim]
    holding: int
    wall_s: float
