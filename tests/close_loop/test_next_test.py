"""Which test comes next: what it is expected to tell, against integrals; what is proposed for ramps; the loop closed again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from answers import check_answer
from command import command
from test_close_loop import written

from explicitfe.app.api.inverse import close_loop, design_test
from explicitfe.inverse.close_loop.next_test import Foretold, bhattacharyya, entropy_bits, expected_bits, separation
from explicitfe.inverse.close_loop.proposals import LOAD_FACTOR, PACE_FACTOR, proposals, room_of
from explicitfe.inverse.measured.curve import programme_of
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.inverse.measured.tables import RigLimits
from explicitfe.platform.errors import InputError

pytestmark = pytest.mark.slow

FEW = ("viscoelastic", "third-yeoh", "softening")


def foretold(mean: float, probability: float = 0.5, spread: float = 0.0) -> Foretold:
    return Foretold(probability, np.array([mean]), np.array([[spread]]))


def information(models: list[Foretold]) -> float:
    """Mutual information of the model and one row in bits, by quadrature."""
    x = np.linspace(-60.0, 60.0, 200_001)
    sds = [float(np.sqrt(1.0 + (m.spread**2).sum())) for m in models]
    densities = np.array(
        [np.exp(-0.5 * ((x - m.mean[0]) / sd) ** 2) / (sd * np.sqrt(2.0 * np.pi)) for m, sd in zip(models, sds, strict=True)]
    )
    p = np.array([m.probability for m in models])
    mixture = p @ densities
    ratio = np.log2(np.maximum(densities, 1e-300) / np.maximum(mixture, 1e-300))
    return float((p[:, None] * densities * ratio).sum() * (x[1] - x[0]))


@pytest.mark.parametrize(
    "models",
    [
        [foretold(0.0), foretold(1.0)],
        [foretold(0.0), foretold(3.0)],
        [foretold(0.0, 0.7), foretold(0.0, 0.3, 5.0)],
        [foretold(0.0, 0.2), foretold(2.0, 0.5, 1.0), foretold(-4.0, 0.3)],
    ],
)
def test_expected_information_is_a_lower_bound_near_the_truth(models):
    """The bound of Kolchinsky & Tracey (2017) is no larger than the integral, and here no less than half of it."""
    bits, truth = expected_bits(models), information(models)
    assert 0.5 * truth <= bits <= truth + 1e-9


def test_limits_of_information():
    """Equal models tell nothing; models that are far apart all that is open."""
    assert expected_bits([foretold(1.0), foretold(1.0)]) == pytest.approx(0.0, abs=1e-12)
    far = [foretold(0.0, 0.75), foretold(100.0, 0.25)]
    assert expected_bits(far) == pytest.approx(entropy_bits([0.75, 0.25]))
    assert bhattacharyya([foretold(0.0), foretold(2.0)])[0, 1] == pytest.approx(0.5)
    assert separation(foretold(0.0, spread=3.0), foretold(5.0, spread=4.0)) == pytest.approx(25.0 / 26.0)


@pytest.fixture(scope="module")
def slow(tmp_path_factory):
    """Ramps at one rate, of a tissue that relaxes: nothing in them can show it."""
    return written(tmp_path_factory.mktemp("next") / "slow", rates=(0.1, 0.1, 0.1), lines=lambda k: "[curve.conditions]\nday = 1")


@pytest.fixture(scope="module")
def before(slow, tmp_path_factory):
    """What the loop says of them, and the folder where it stands."""
    folder = tmp_path_factory.mktemp("before") / "report"
    return close_loop(slow, out=folder, effects=FEW, processes=1), folder


def test_proposals_stay_in_the_room_of_the_rig(slow):
    curves = read_dataset(slow).curves
    for limits in (RigLimits(), RigLimits(largest_strain=0.2, shortest_ramp_s=1.0, longest_test_s=30.0)):
        room = room_of(curves, limits)
        made = list(proposals(curves, limits))
        assert len(made) >= 4 and len({p.words for p in made}) == len(made)
        for proposal in made:
            way, t = 1.0 - programme_of(proposal.curve), proposal.curve.time_s
            assert way[0] == 0.0 and t[0] == 0.0 and np.all(np.diff(t) > 0.0)
            assert np.abs(way).max() <= room.load * (1.0 + 1e-9) and t[-1] <= room.test_s * (1.0 + 1e-9)
            assert proposal.minutes(limits) == pytest.approx(5.0 + t[-1] / 60.0)
    free = room_of(curves, RigLimits())
    assert free.load == pytest.approx(LOAD_FACTOR * 0.3) and free.ramp_s == pytest.approx(3.0 / PACE_FACTOR)


def test_the_proposed_test_shows_what_ramps_at_one_rate_cannot(slow, before, tmp_path):
    """Relaxation cannot be seen in ramps at one rate, so a test with a time scale is proposed; measured, it names the cause."""
    report, _ = before
    assert "viscoelastic" not in report.effects
    best = report.proposed_tests[0]
    assert best == report.next_experiment and best.information_bits > 0.1 and best.minutes > 5.0
    ranks = [one.information_bits / one.minutes for one in report.proposed_tests]
    assert ranks == sorted(ranks, reverse=True)
    way = np.array(best.programme)[:, 1]
    assert best.imposed == "stretch" and way[0] == 1.0
    # What is proposed is replaced by a hold, of which the closed form of the ramps gives nothing; a fast ramp is as good.
    more = written(tmp_path / "more", rates=(2.0, 0.005), seed=3)
    renamed = (more / "dataset.toml").read_text(encoding="utf-8").replace('id = "ramp-', 'id = "more-')
    (more / "dataset.toml").write_text(renamed, encoding="utf-8")
    after = close_loop(slow, add=[more], effects=FEW, processes=1)
    assert (after.verdict, after.effects) == ("effect-found", ["viscoelastic"])
    assert {"more-0", "more-1"} <= set(after.split.fit) and "what was added is fitted" in after.split.rule
    assert after.posterior["viscoelastic"] > report.posterior.get("viscoelastic", 0.0)


def test_what_cannot_be_added(slow, tmp_path):
    with pytest.raises(InputError, match=r"is in .* already; give it another id"):
        close_loop(slow, add=[slow], processes=1)
    other = written(tmp_path / "other")
    text = (other / "dataset.toml").read_text(encoding="utf-8").replace('test = "compression"', 'test = "tension"')
    (other / "dataset.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match='this is a test of "tension"'):
        close_loop(slow, add=[other], processes=1)


def test_a_rig_in_a_dataset(slow):
    text = (slow / "dataset.toml").read_text(encoding="utf-8")
    assert read_dataset(slow).rig is None
    (slow / "dataset.toml").write_text(text.replace("[noise]", "[rig]\nlargest_strain = 0.4\n[noise]"), encoding="utf-8")
    rig = read_dataset(slow).rig
    (slow / "dataset.toml").write_text(text, encoding="utf-8")
    assert rig is not None and rig.largest_strain == 0.4


def test_proposals_are_protocols(before, tmp_path, capsys):
    """By the command, from the report that is there: each protocol can be planned as it stands."""
    report, folder = before
    assert command(["design-test", str(folder), "--propose", "--out", str(tmp_path / "tests"), "--json"]) == 0
    answer = check_answer("design-test", capsys.readouterr().out)
    assert [test["protocol"] for test in answer["tests"]] == [test.protocol for test in report.proposed_tests]
    assert [Path(name).name for name in answer["files"]] == ["proposed-tests.json", *(f"test-{k + 1}.toml" for k in range(3))]
    planned = design_test(tmp_path / "tests" / "test-1.toml", processes=1)
    assert planned.protocol == report.proposed_tests[0].protocol and any(effect.shows for effect in planned.effects)
