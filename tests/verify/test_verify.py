"""``explicitfe verify``: the table of the page, quick claims, and claims that do not hold."""

from __future__ import annotations

from dataclasses import replace

import pytest
from answers import check_answer
from command import command
from support import ROOT

from explicitfe.app.verify import bodies, data, one_element, speech, verify
from explicitfe.app.verify.claim import ClaimFigure, Workshop
from explicitfe.app.verify.claims import CLAIMS
from explicitfe.platform.errors import InputError, RunError

PAGE = ROOT / "docs" / "is-it-true.md"
QUICK = ("one-element", "febio", "order-in-time", "tubes", "other-casting")
LONGEST_S = 600.0


def test_the_page_is_the_list() -> None:
    """Update it with: python -c "from explicitfe.app.verify.verify import markdown_table; print(markdown_table(), end='')" """
    text = PAGE.read_text(encoding="utf-8")
    table = text.partition("<!-- begin claims")[2].partition("-->\n")[2].partition("<!-- end claims")[0]
    assert table.strip() == verify.markdown_table().strip()


def test_every_claim_has_a_reference_and_limits() -> None:
    names = [claim.name for claim in CLAIMS]
    assert len(set(names)) == len(names) >= 12
    for claim in CLAIMS:
        assert claim.sentence.endswith(".") and claim.fails.endswith(".") and claim.source and claim.because and claim.reference
        assert claim.allowed >= 0.0 and claim.seconds > 0.0
    assert sum(claim.seconds for claim in CLAIMS) < LONGEST_S


def test_references_state_the_numbers_that_are_compared() -> None:
    stated = {claim.name: claim.reference for claim in CLAIMS}
    assert stated["cantilever"] == ", ".join(f"{rise:.2f} mm at {time} ms" for time, rise in bodies.END_RISES_MM.items())
    for name, depths in (("flat-punch", bodies.PUNCH_MM), ("glued-disc", bodies.DISC_MM)):
        assert stated[name] == f"{depths[0]:.3f} mm at 0.1 N to {depths[-1]:.3f} mm at 0.8 N"
    assert stated["muscles"] == f"{len(speech.MUSCLES)} of {len(speech.MUSCLES)} muscles"
    assert stated["constants"] == f"C10 {data.CONSTANTS_PA[0]:g} Pa, C20 {data.CONSTANTS_PA[1]:g} Pa"
    for vowel, (f1, f2) in speech.MEN_HZ.items():
        assert f"[{vowel}] {f1:.0f} {f2:.0f} Hz" in stated["vowel-triangle"]
        assert f"[{vowel}] {f1:.0f} to {speech.WOMEN_HZ[vowel][0]:.0f}, {f2:.0f} to" in stated["vowel-formants"]


@pytest.mark.parametrize("name", QUICK)
def test_quick_claims_hold(name: str) -> None:
    (row,) = verify.verify([name])["claims"]
    assert row["holds"] and row["off"] is not None and row["off"] <= row["allowed"] and row["measured"], row


def test_a_claim_that_does_not_hold_fails(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """The stress of FEBio in one state changed by 0.1 %: the claim fails, and the command ends with exit code 3."""
    wrong = dict(one_element.FEBIO_PA)
    wrong["tension", 1.5] *= 1.001
    monkeypatch.setattr(one_element, "FEBIO_PA", wrong)
    assert command(["verify", "--only", "febio", "--only", "tubes", "--json"]) == 3
    answer = check_answer("verify", capsys.readouterr().out)
    assert answer["holding"] == 1 and [row["holds"] for row in answer["claims"]] == [False, True]
    assert answer["failure"]["kind"] == "check" and "febio" in answer["failure"]["message"]
    assert answer["claims"][0]["off"] == pytest.approx(1e-3, rel=0.01)
    assert command(["verify", "--only", "febio"]) == 3
    printed = capsys.readouterr()
    assert "fails" in printed.out and "0 of 1" in printed.out
    assert "do not hold on this machine: febio" in printed.err.replace("\n", " ")


def test_a_claim_that_cannot_be_computed_does_not_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(_: Workshop) -> ClaimFigure:
        raise RunError("the run stopped early.")

    first, second = replace(CLAIMS[0], figure=fails), CLAIMS[1]
    monkeypatch.setattr(verify, "CLAIMS", (first, second))
    verification = verify.verify()
    rows = verification["claims"]
    assert [row["holds"] for row in rows] == [False, True] and verification["holding"] == 1
    assert rows[0]["message"] == "the run stopped early." and rows[0]["off"] is None


def test_an_unknown_claim_is_refused() -> None:
    with pytest.raises(InputError, match=r'unknown claim .febbio.; did you mean "febio"'):
        verify.verify(["febbio"])
