"""What the tongue does in each of its scenarios: its question, and the numbers that its file expects."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from support import ROOT

from explicitfe.fem.mesh.surface_points import surface_areas
from explicitfe.fem.model.model import Model
from explicitfe.results.files import open_result
from explicitfe.results.measure.document import Measures
from explicitfe.results.measure.measure import measures_of
from explicitfe.results.measure.numbers import numbers_at
from explicitfe.results.measure.sections import X, Y, Z, midsagittal, section, station
from explicitfe.results.measure.steps import last_step, step_at
from explicitfe.results.measure.tract import crossings
from explicitfe.simulate.run.crossings import CROSSING_WARNING_M
from explicitfe.simulate.run.prepare import prepare
from explicitfe.simulate.scenario.transient import TransientScenario

SCENARIOS = ROOT / "scenarios"
OF_THE_PAPER = "vowel-i-gerard-2005"

# A number of a file is rounded; another machine computes other last bits, and contact amplifies them. Contact area counts whole
# nodes of up to 50 mm2, and an electrode touches or does not.
TOLERANCES = {"_mm": 0.15, "_hz": 10.0, "airway.smallest_area_mm2": 3.0, "contact.palate.area_mm2": 60.0, "contacts": 1.0}
# No node goes deeper into bone beyond where it was at rest: 6 kPa of contact, twice what a tongue presses on teeth in speech.
DEEPEST_MM = 0.3
# A point of the tongue that moves less than this in another 100 ms stands still, however small the gesture.
STANDS_STILL_MM = 0.3
STILL_STEPS = 10  # samples every 2 ms


class Ran(NamedTuple):
    """A scenario that has run."""

    scenario: TransientScenario
    model: Model
    summary: dict[str, Any]
    measures: Measures
    displacement: np.ndarray
    result: Path

    def forward(self, point: str) -> float:
        """How far a point has come forward, mm."""
        return self.measures.points[point].forward_mm

    def up(self, point: str) -> float:
        """How far a point has risen, mm."""
        return self.measures.points[point].up_mm

    def touches(self, bone: str, side: str) -> bool:
        """Whether a side of a bone is touched: "left", "centre" or "right"."""
        return any(cell.area_mm2 > 0.0 for cell in self.measures.contact[bone].cells[side].values())

    def wider_mm(self, place: str) -> float:
        """By how much the coronal section at a station has become wider."""
        mesh = self.model.mesh
        cut = section(mesh, X, station(mesh, place))
        before, now = (1e3 * np.ptp(cut.at(points)[:, Y]) for points in (mesh.points, mesh.points + self.displacement))
        return float(now - before)

    def depth_mm(self) -> float:
        """How deep the deepest node lies in bone, where that is at the end, beyond its depth at rest."""
        mesh = self.model.mesh
        surface = surface_areas(mesh) > 0.0
        at_rest, now = mesh.points[surface], (mesh.points + self.displacement)[surface]
        depths = []
        for bone in self.model.bones:
            of_bone = now
            if bone.motion is not None:
                rotation, shift = bone.motion.placement(np.array([self.summary["simulated_s"]]))
                of_bone = (now - shift[0]) @ rotation[0]
            depths.append(np.minimum(bone.field.at(at_rest)[0], 0.0) - bone.field.at(of_bone)[0])
        return 1e3 * float(np.max(depths))

    def root_back_mm(self) -> float:
        """How far the rear of the midsagittal outline has come back between z = 75 and 100 mm, at most."""
        mesh = self.model.mesh
        outline = midsagittal(mesh)
        loop = max(outline.loops, key=len)
        rear = []
        for points in (mesh.points, mesh.points + self.displacement):
            at = outline.at(points)[loop][:, [X, Z]]
            lines = np.stack([at, np.roll(at, -1, axis=0)], axis=1)[:, :, ::-1]
            rear.append(np.fmax.reduce(crossings(lines, 1e-3 * np.arange(75.0, 101.0)), axis=1))
        return 1e3 * float(np.max(rear[1] - rear[0]))


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Ran]:
    """Runs a scenario once."""
    folder = tmp_path_factory.mktemp("tongues")

    @cache
    def run_once(name: str) -> Ran:
        prepared = prepare(SCENARIOS / f"{name}.toml", ['record.fields=["velocity"]'])
        target = Path(folder / f"{name}.vtkhdf")
        summary = prepared.run(target, overwrite=False, progress=lambda what, share: None)
        with open_result(target) as result:
            measures, displacement = measures_of(result, last_step(result)), result.displacement()
        return Ran(prepared.scenario, prepared.model, summary, measures, displacement, target)

    return run_once


TONGUES = sorted(path.stem for path in SCENARIOS.glob("*.toml") if 'name = "tongue"' in path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", TONGUES)
def test_numbers_are_those_that_the_file_expects(name, ran, record_property):
    """All numbers of the tables [[expected]], which the report of a run and the documentation show."""
    done = ran(name)
    assert done.scenario.question.endswith("?") and done.scenario.expect and done.scenario.expected
    for expected in done.scenario.expected:
        time_ms = expected.get("time_ms")
        with open_result(done.result) as result:
            seen = numbers_at(result, None if time_ms is None else 1e-3 * time_ms, "airway" in " ".join(expected))
        for measure, stated in expected.items():
            tolerance = next(value for unit, value in TOLERANCES.items() if measure.endswith((unit, "time_ms")))
            record_property(measure, seen[measure])
            assert seen[measure] == pytest.approx(stated, abs=tolerance), (measure, time_ms)


@pytest.mark.parametrize("name", [name for name in TONGUES if name != OF_THE_PAPER])
def test_a_gesture_is_sound(name, ran, record_property):
    """It ends, stands still, keeps its energy, its elements and its symmetry, and stays out of bone."""
    done = ran(name)
    summary = done.summary
    record_property("deepest / mm", done.depth_mm())
    record_property("hourglass share", summary["hourglass_share"])
    assert summary["status"] == "finished"
    with open_result(done.result) as result:
        last = last_step(result)
        before = result.displacement(last - STILL_STEPS)
        speed_mm_s = (
            1e3 * np.linalg.norm(done.displacement - before, axis=1) / (result.times[last] - result.times[last - STILL_STEPS])
        )
    record_property("fastest node / mm/s", speed_mm_s.max())
    # The mean over 20 ms: in contact single nodes of the medium mesh vibrate at up to 13 mm/s.
    assert 0.1 * np.quantile(speed_mm_s, 0.99) < max(0.05 * summary["largest_displacement_mm"], STANDS_STILL_MM)
    assert summary["energy_balance_error"] < 1e-3
    assert summary["folded"]["elements"] == 0 and summary["folded"]["undecided"] == 0
    assert ("No warnings." in done.scenario.expect.replace("\n", " ")) == (summary["warnings"] == [])
    assert done.depth_mm() < DEEPEST_MM
    through = done.measures.body.self_penetration
    assert through.nodes == 0 or (done.model.surfaces is not None and through.deepest_mm < 1e3 * CROSSING_WARNING_M)
    if not done.scenario.resection:
        assert done.measures.body.left_right_mm is not None and done.measures.body.left_right_mm < 1e-6


# ---- the questions ----


@pytest.mark.parametrize("name", ["vowel-i", "vowel-i-braced", "vowel-i-palatal", "ggp-alone"])
def test_the_tongue_of_an_i_is_in_front_high_and_touches_with_its_sides(name, ran):
    """Gibbon, Lee, Yuen (2010): in [i] the sides touch the palate and the centre is free, in every speaker."""
    done = ran(name)
    assert done.measures.highest.forward_mm > 2.0 and done.measures.highest.up_mm > 0.2
    assert done.touches("palate", "left") and done.touches("palate", "right")
    assert done.measures.contact["palate"].midline_free
    constriction = done.measures.constriction
    assert constriction.width_mm < 0.8 * constriction.width_at_rest_mm and constriction.place_mm < 55.0  # the hard palate


def test_the_best_i_is_higher_than_that_of_the_genioglossus_alone(ran):
    """The constriction of [i] is narrow over a length (Fant 1960), for which TRANS and STY are needed beside GGp."""
    best, genioglossus = ran("vowel-i-palatal").measures, ran("vowel-i").measures
    assert best.highest.up_mm > genioglossus.highest.up_mm + 5.0
    assert best.constriction.width_mm < 0.5 * genioglossus.constriction.width_mm
    assert best.palatogram is not None and genioglossus.palatogram is not None
    touched = [sum(bool(one) for row in measures.palatogram.now.electrodes for one in row) for measures in (best, genioglossus)]
    assert touched[0] >= 12 and touched[0] > touched[1] + 8


def test_bracing_holds_the_tip_back_and_keeps_it_high(ran):
    plain, braced = ran("vowel-i"), ran("vowel-i-braced")
    assert braced.up("tip") > plain.up("tip") - 0.2
    assert braced.forward("tip") < plain.forward("tip") - 0.5  # SL holds it back


def test_middle_genioglossus_lowers_the_dorsum(ran):
    done = ran("ggm-alone")
    assert done.up("dorsum") < -1.0 and done.forward("dorsum") > 2.0
    assert done.measures.grooves["dorsum"].depth_mm > 0.3


def test_horizontal_genioglossus_draws_the_root_forward_and_lifts(ran):
    done = ran("ggh-alone")
    assert done.forward("base") > 0.5 and done.up("dorsum") > 0.3 and done.forward("dorsum") > 0.3


def test_inferior_longitudinal_draws_the_tip_down_and_back(ran):
    done = ran("il-alone")
    assert done.up("tip") < -3.0 and done.forward("tip") < -8.0


def test_styloglossus_draws_back_and_up(ran):
    done = ran("sty-alone")
    assert done.forward("dorsum") < -3.0 and done.up("dorsum") > 1.0
    assert done.touches("palate", "left") and done.touches("palate", "right")


def test_hyoglossus_draws_back_and_down(ran):
    done = ran("hg-alone")
    assert done.forward("dorsum") < -3.0 and done.up("dorsum") < -0.7


def test_verticalis_flattens(ran):
    """Its front sinks and the tip comes forward; the sections get wider."""
    done = ran("vert-alone")
    assert done.up("front") < -0.2 and done.forward("tip") > 0.3
    assert done.wider_mm("front") > 0.2 and done.measures.highest.up_mm < 0.0


def test_transversus_narrows_and_lifts(ran):
    done = ran("trans-alone")
    assert done.wider_mm("dorsum") < -0.3 and done.wider_mm("front") < -0.3
    assert done.up("dorsum") > 0.3 and done.forward("tip") > 0.3


def test_geniohyoid_draws_the_hyoid_forward(ran):
    """The nodes of the patch that the hyoid bone holds."""
    done = ran("gh-alone")
    hyoid = done.displacement[done.model.mesh.node_sets["hyoid"]]
    assert -1e3 * hyoid[:, X].mean() > 0.5
    assert done.forward("base") > 0.1 and done.up("base") < -0.3


def test_mylohyoid_lifts(ran):
    done = ran("mh-alone")
    assert done.up("dorsum") > 0.2 and done.up("tip") > 0.5


# ---- speech: docs/studies/speech.md ----

HELD_S = 0.14  # both stops are closed or not until 150 ms


def test_vowels_lie_in_their_corners(ran):
    """[i] high and in front, [e] below it, [u] high and back, [a] low with its root back: the highest point, against rest."""
    top = {name: ran(f"vowel-{name}").measures.highest for name in ("i-palatal", "e", "a", "u")}
    assert top["i-palatal"].up_mm > 2.0 and top["i-palatal"].forward_mm > 3.0
    assert 0.5 < top["e"].up_mm < top["i-palatal"].up_mm - 1.0 and top["e"].forward_mm > 2.0
    assert top["u"].up_mm > 1.5 and top["u"].forward_mm < -0.5
    assert top["a"].up_mm < -5.0 and top["a"].forward_mm < 1.0
    assert ran("vowel-a").root_back_mm() > 5.0 and ran("vowel-i-palatal").root_back_mm() < -2.0


def test_vowels_are_narrow_where_phonetics_has_them_so(ran):
    """Wood (1979): [i] and [e] at the hard palate, [u] at the soft one, behind 60 mm, and [a] at neither."""
    for name, narrowest, place in (
        ("i-palatal", (0.5, 2.0), (10.0, 55.0)),
        ("e", (2.5, 5.0), (10.0, 45.0)),
        ("u", (1.0, 4.0), (60.0, 99.0)),
    ):
        constriction = ran(f"vowel-{name}").measures.constriction
        assert narrowest[0] < constriction.width_mm < narrowest[1], name
        assert place[0] < constriction.place_mm < place[1], name
    sections = ran("vowel-a").measures.constriction.sections
    assert min(section.height_mm for section in sections if section.height_mm is not None and section.place_mm < 60.0) > 10.0


def test_an_i_touches_with_its_sides_and_an_a_does_not(ran):
    for name in ("i-palatal", "u"):
        palate = ran(f"vowel-{name}").measures.contact["palate"]
        assert palate.midline_free and ran(f"vowel-{name}").touches("palate", "left")
    assert ran("vowel-a").measures.contact["palate"].area_mm2 == 0.0


def held(done: Ran) -> Measures:
    """The measures of a stop before its release."""
    with open_result(done.result) as result:
        return measures_of(result, step_at(result, HELD_S))


@pytest.mark.parametrize("name", ["alveolar-t", "velar-k", "sequence-aka", "sequence-ata"])
def test_a_stop_leaks_nowhere_for_as_long_as_in_speech(name, ran):
    """Closures of stops last 60 to 130 ms."""
    leak = ran(name).measures.leak
    assert not leak.closed
    assert [60.0 < closure.duration_ms < 130.0 for closure in leak.closures] == [True]


def test_a_t_closes_behind_the_teeth_and_opens_again(ran):
    """A horseshoe (Gibbon, Yuen, Lee & Adams 2007), at the pressure of a tongue in speech, 0.2 to 3 kPa."""
    done = ran("alveolar-t")
    closed, released = held(done), done.measures
    palate = closed.contact["palate"]
    assert not palate.midline_free and palate.cells["centre"]["front"].area_mm2 > 0.0
    assert 0.2 < palate.peak_kPa < 3.0
    rows = closed.palatogram.now.electrodes
    assert closed.palatogram.now.closed_rows[0] <= 2
    for row in rows[1:5]:
        assert row[0] and row[7]
    assert closed.leak.closed and closed.constriction.place_mm < 20.0
    assert released.contact["palate"].area_mm2 == 0.0


def test_a_k_closes_at_a_velum_that_gives_way(ran):
    """Where the hard palate ends, at the pressure of a tongue in speech."""
    done = ran("velar-k")
    closed = held(done)
    assert closed.leak.closed and 55.0 < closed.leak.place_mm < 75.0
    for row in closed.palatogram.now.electrodes[6:]:
        assert sum(map(bool, row)) >= 4
    assert 0.2 < closed.contact["palate"].peak_kPa < 3.0
    with open_result(done.result) as result:
        assert 200.0 < result.field("surface_pressure", time_s=HELD_S).max() < 3000.0
    assert done.measures.constriction.width_mm > 1.0


def test_the_levator_lowers_the_velum_and_lifts_it_again(ran):
    """Its support moves 2 mm forward and 8 mm down; what hangs from it follows, and comes back."""
    done = ran("velum-lowered")
    with open_result(done.result) as result:
        low = measures_of(result, step_at(result, HELD_S))
    uvula = low.points["velum.uvula"]
    assert -8.5 < uvula.up_mm < -7.0 and 3.0 < uvula.forward_mm < 5.0
    assert abs(done.measures.points["velum.uvula"].up_mm) < TOLERANCES["_mm"]


def test_soft_walls_of_the_pharynx_give_way_to_the_root(ran):
    """Outwards, by one to three millimetres, alike on both sides; the root goes further back, and formants stay."""
    soft, rigid = ran("vowel-a-soft"), ran("vowel-a")
    mesh, u = soft.model.mesh, soft.displacement
    walls = mesh.node_sets["pharynx-walls"]
    outwards = 1e3 * u[walls, Y] * np.sign(mesh.points[walls, Y])
    assert 1.0 < outwards.max() < 3.0 and outwards.min() > -1.0
    right, left = (soft.measures.points[f"pharynx-walls.{side}"] for side in ("right", "left"))
    assert abs(right.up_mm - left.up_mm) < 1e-6 and abs(right.forward_mm - left.forward_mm) < 1e-6
    held = np.concatenate([mesh.node_sets[f"pharynx-walls.{name}"] for name in ("outer", "rear")])
    assert not u[held].any()
    with open_result(soft.result) as result:
        pressure = result.field("surface_pressure", len(result.times) - 1)
    on_walls = np.isin(np.arange(mesh.node_count), walls)
    shares = [float((pressure * surface_areas(mesh))[side].sum()) for side in (on_walls, ~on_walls)]
    assert shares[0] == pytest.approx(shares[1], rel=1e-9) and 0.3 < shares[0] < 1.0
    assert pressure.max() < 6000.0
    for point in ("dorsum", "back"):
        assert -0.6 < soft.forward(point) - rigid.forward(point) < -0.05
    assert soft.measures.contact["pharynx"].force_N < rigid.measures.contact["pharynx"].force_N


def test_without_ggm_sl_closes_nothing_and_leaves_the_dorsum_high(ran):
    """Gérard et al. (2005), section 5: SL raises the tip while the dorsum stays high; GGm is needed to flatten it."""
    alone, together = held(ran("alveolar-t-sl")), held(ran("alveolar-t"))
    assert alone.contact["palate"].midline_free and alone.leak.width_mm > 0.5
    assert alone.points["dorsum"].up_mm > together.points["dorsum"].up_mm + 1.3
    assert alone.points["back"].up_mm > together.points["back"].up_mm + 1.0


def test_a_sequence_comes_to_rest_in_each_vowel(ran):
    """[i] [a] [u]: where the single vowels are, standing still, and at the speeds of speech in between."""
    done = ran("sequence-iau")
    with open_result(done.result) as result:
        for name, time_s in (("vowel-i-palatal", 0.198), ("vowel-a", 0.468), ("vowel-u", 0.738)):
            step = step_at(result, time_s)
            assert abs(float(result.times[step]) - time_s) < 0.011  # recorded every 20 ms
            seen, alone = measures_of(result, step), ran(name).measures
            for point in ("tip", "front", "dorsum", "back"):
                here, there = seen.points[point], alone.points[point]
                assert np.hypot(here.forward_mm - there.forward_mm, here.up_mm - there.up_mm) < 0.7, (name, point)
            assert seen.body.fastest_mm_s < 8.0
    for point, fastest in (("tip", 200.0), ("dorsum", 250.0)):
        assert 60.0 < done.measures.points[point].peak_speed_mm_s < fastest


def test_half_a_tongue_leans_to_the_operated_side(ran):
    """The intact one stays in the middle (docs/studies/surgery.md)."""
    done, intact = ran("glossectomy-half"), ran("vowel-i")
    assert done.measures.points["tip"].right_mm == pytest.approx(2.6, abs=TOLERANCES["_mm"])
    assert abs(intact.measures.points["tip"].right_mm) < 1e-6
    assert done.forward("dorsum") > intact.forward("dorsum") + 1.0
    assert 0.0 < done.measures.contact["palate"].area_mm2 < 0.8 * intact.measures.contact["palate"].area_mm2


# ---- the paper's, without bones ----


def test_without_bones_the_tip_of_the_papers_tongue_falls(ran):
    """Forces on nodes of cadaver tissue draw it over the chin and through it."""
    done = ran(OF_THE_PAPER)
    assert not done.model.bones and not done.model.stresses
    assert done.up("tip") < -20.0
    assert any("hourglass" in warning for warning in done.summary["warnings"])
