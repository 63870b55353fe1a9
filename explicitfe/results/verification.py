"""What ``explicitfe verify`` says of each claim."""

from __future__ import annotations

from typing_extensions import TypedDict


class VerifiedClaim(TypedDict):
    """A claim that was computed on this machine.

    Attributes
    ----------
    evidence : closed form, other program, published, measured data, or own data.
    measured, reference : what was computed and what it is compared with, in words.
    off, allowed, unit : how far they are apart, and how far they may be; ``off`` is None where nothing could be computed.
    fails : how far the claim goes.
    message : why it could not be computed; "" if it could.
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
    """All claims that were asked for.

    Attributes
    ----------
    holding : how many hold.
    version : of explicitfe.
    """

    version: str | None
    claims: list[VerifiedClaim]
    holding: int
    wall_s: float
