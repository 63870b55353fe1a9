"""A further test of a blind case has its truth, in both families; and whether further tests can show what is hidden."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from explicitfe.inverse.close_loop.next_test import reported_programme
from explicitfe.inverse.close_loop.proposals import ProposedCurve
from explicitfe.inverse.measured.read import read_dataset
from studies.blind import homogeneous, identifiable
from studies.blind.again import distance_with, measure_again
from studies.blind.case import CaseRequest, write
from studies.blind.foreign import homogeneous_cases

pytestmark = pytest.mark.slow

SILENT_NOISE = 1e-7
DRAWS = {"homogeneous": (homogeneous, homogeneous.draw), "foreign": (homogeneous_cases, homogeneous_cases.draw_homogeneous)}


def drawn(monkeypatch, folder, family, subject, mode, level):
    """Curves and truth of a case of this mode, without its distances, which take longest."""
    module, draw = DRAWS[family]
    monkeypatch.setattr(module, "_distances", lambda *_: None)
    rng = np.random.default_rng(100)
    while True:
        case = draw(rng, CaseRequest("single", (subject,), level))
        if case.truth["mode"] == mode:
            break
    write(case, folder, "case")
    return read_dataset(folder).curves, json.loads(json.dumps(case.truth)) | {"family": family}


@pytest.mark.parametrize(
    ("family", "subject", "mode"), [("homogeneous", "viscoelastic", "platen"), ("foreign", "softening", "shear")]
)
def test_the_same_test_again_reads_the_same(monkeypatch, tmp_path, family, subject, mode):
    curves, truth = drawn(monkeypatch, tmp_path / "case", family, subject, mode, SILENT_NOISE)
    first = curves[0]
    proposal = reported_programme(ProposedCurve("again", first), 2)
    measure_again(np.random.default_rng(0), truth, proposal, tmp_path / "again", "again")
    twice = read_dataset(tmp_path / "again").curves
    assert [c.id for c in twice] == ["again-1", "again-2"]
    for again in twice:
        own = first.columns[first.predicted]
        assert again.columns[again.predicted] == pytest.approx(own, abs=1e-5 * float(np.abs(own).max()))


@pytest.mark.parametrize("family", DRAWS)
def test_what_further_tests_can_show(monkeypatch, tmp_path, family):
    """A third Yeoh term that noise hides is shown by as many repeats as it takes; repeats of a small load show nothing.

    The distance goes with the noise squared, but for rounding; a thousand repeats of one of two curves add a thousand times at
    most.
    """
    monkeypatch.setattr(identifiable, "possible_effects", lambda _: ("third-yeoh",))
    monkeypatch.setattr("studies.blind.again.rivals_of", lambda *_: {})
    curves, truth = drawn(monkeypatch, tmp_path, family, "third-yeoh", "shear", 0.01)
    source = curves[-1]
    small = replace(source, columns={name: 0.1 * column for name, column in source.columns.items()})
    apart = distance_with(truth, curves[:1], [source], 1.0)
    noisy = truth | {"noise": truth["noise"] | {"sd": np.sqrt(apart) * truth["noise"]["sd"]}}  # a distance of 1
    few, many = (distance_with(noisy, curves[:1], [source], repeats) for repeats in (1.0, 1000.0))
    assert few == pytest.approx(1.0, rel=1e-9) and 100.0 < many < 1000.0 * few
    assert distance_with(noisy, curves[:1], [small], 1000.0) < 0.1 * many
