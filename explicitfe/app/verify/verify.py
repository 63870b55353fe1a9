"""``explicitfe verify``: compute the claims and compare them with their references."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from explicitfe.app.verify.claim import Claim, Workshop
from explicitfe.app.verify.claims import CLAIMS
from explicitfe.platform.errors import InputError, Progress, RunError, Share, nearest, shortened, silent
from explicitfe.results.documents.verification import Verification, VerifiedClaim
from explicitfe.results.files import provenance


def verify(only: Sequence[str] = (), *, progress: Progress = silent) -> Verification:
    """Compute claims and compare each with its reference.

    Parameters
    ----------
    only : names of claims; default: all.
    progress : called with "verify" and the completed share after each claim.

    Raises
    ------
    InputError : a name is unknown.
    """
    begin = time.perf_counter()
    names = [claim.name for claim in CLAIMS]
    for name in only:
        if name not in names:
            raise InputError(f"unknown claim {shortened(name)!r}; {nearest(name, names)}")
    chosen = [claim for claim in CLAIMS if not only or claim.name in only]
    whole, done = sum(claim.seconds for claim in chosen), 0.0
    rows = []
    with tempfile.TemporaryDirectory(prefix="explicitfe-verify-") as folder:
        work = Workshop(Path(folder))
        for number, claim in enumerate(chosen, 1):
            progress("verify", Share(done / whole, f"claim {number} of {len(chosen)}, {claim.name}"))
            rows.append(_verified(claim, work))
            done += claim.seconds
    progress("verify", 1.0)
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
    except RunError as error:  # the claim does not hold; the other claims are computed nevertheless
        row["message"] = str(error)
    else:
        off = float(finding.off)
        row["measured"], row["off"], row["holds"] = finding.text, off, off <= claim.allowed
    row["seconds"] = time.perf_counter() - begin
    return row


def markdown_table() -> str:
    """The table of the page: claim, reference, tolerance, limits."""
    lines = ["| claim | reference | permitted deviation | limits | `--only` |", "|---|---|---|---|---|"]
    for claim in CLAIMS:
        evidence = f"**{claim.evidence}**: {claim.source}"
        allowed = f"{allowed_in_words(claim.allowed, claim.unit)}: {claim.because}"
        lines.append(f"| {claim.sentence} | {evidence} | {allowed} | {claim.fails} | `{claim.name}` |")
    return "\n".join(lines) + "\n"


def allowed_in_words(value: float, unit: str) -> str:
    """A deviation with its unit; shares of at least 1e-5 in per cent."""
    if unit and not unit.startswith("of "):
        return f"{value:g} {unit}"
    share = f"{100.0 * value:.3g} %" if value >= 1e-5 else f"{value:.2g}".replace("e-0", "e-")
    return f"{share} {unit}".rstrip()
