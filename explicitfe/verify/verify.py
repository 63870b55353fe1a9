"""``explicitfe verify``: every claim computed anew, and whether it holds."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from explicitfe.errors import InputError, Progress, RunError, nearest, shortened, silent
from explicitfe.results import provenance
from explicitfe.results.verification import Verification, VerifiedClaim
from explicitfe.verify.claim import Claim, Workshop
from explicitfe.verify.claims import CLAIMS


def verify(only: Sequence[str] = (), *, progress: Progress = silent) -> Verification:
    """Compute claims, and compare each with its reference.

    Parameters
    ----------
    only : names of claims; all if left out.
    progress : called with "verify" and the share that is done, between claims.

    Raises
    ------
    InputError : there is no such claim.
    """
    begin = time.perf_counter()
    names = [claim.name for claim in CLAIMS]
    for name in only:
        if name not in names:
            raise InputError(f"there is no claim {shortened(name)!r}; {nearest(name, names)}")
    chosen = [claim for claim in CLAIMS if not only or claim.name in only]
    whole, done = sum(claim.seconds for claim in chosen), 0.0
    rows = []
    progress("verify", 0.0)
    with tempfile.TemporaryDirectory(prefix="explicitfe-verify-") as folder:
        work = Workshop(Path(folder))
        for claim in chosen:
            rows.append(_verified(claim, work))
            done += claim.seconds
            progress("verify", done / whole)
    return {
        "version": provenance()["explicitfe"],
        "claims": rows,
        "holding": sum(row["holds"] for row in rows),
        "wall_s": time.perf_counter() - begin,
    }


def _verified(claim: Claim, work: Workshop) -> VerifiedClaim:
    begin = time.perf_counter()
    row: VerifiedClaim = {
        "name": claim.name,
        "claim": claim.sentence,
        "evidence": claim.evidence,
        "measured": "",
        "reference": claim.reference,
        "source": claim.source,
        "off": None,
        "allowed": claim.allowed,
        "unit": claim.unit,
        "holds": False,
        "fails": claim.fails,
        "message": "",
        "seconds": 0.0,
    }
    try:
        finding = claim.figure(work)
    except RunError as error:  # what cannot be computed does not hold, and the others are computed nevertheless
        row["message"] = str(error)
    else:
        off = float(finding.off)
        row["measured"], row["off"], row["holds"] = finding.text, off, off <= claim.allowed
    row["seconds"] = time.perf_counter() - begin
    return row


def markdown_table() -> str:
    """The claims as the table of the page: claim, evidence, how far off it may be, where it fails."""
    lines = ["| claim | compared with | may be off by | where it fails | `--only` |", "|---|---|---|---|---|"]
    for claim in CLAIMS:
        evidence = f"**{claim.evidence}**: {claim.source}"
        allowed = f"{allowed_in_words(claim.allowed, claim.unit)}: {claim.because}"
        lines.append(f"| {claim.sentence} | {evidence} | {allowed} | {claim.fails} | `{claim.name}` |")
    return "\n".join(lines) + "\n"


def allowed_in_words(value: float, unit: str) -> str:
    """A deviation with its unit: shares of at least a thousandth in per cent."""
    if unit and not unit.startswith("of "):
        return f"{value:g} {unit}"
    share = f"{100.0 * value:.3g} %" if value >= 1e-5 else f"{value:.2g}".replace("e-0", "e-")
    return f"{share} {unit}".rstrip()
