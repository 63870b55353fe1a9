"""What a planned protocol can find: the smallest strength against data made with it, and protocols that cannot be used."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from answers import check_answer
from command import command
from rich.console import Console

from explicitfe.app.api.inverse import design_test
from explicitfe.app.view.terminal.design import design_tables
from explicitfe.fem.effects import EFFECTS
from explicitfe.fem.effects.material.viscoelastic import Viscoelastic
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import point
from explicitfe.inverse.close_loop import design
from explicitfe.inverse.close_loop.specimens.simulator import Simulator
from explicitfe.platform.errors import InputError
from explicitfe.platform.host.shipped import protocols
from explicitfe.results.documents.planned_test import EffectInTest, PlannedTest
from explicitfe.results.documents.units_of_keys import words_and_unit

SD_PA, STRAIN, RATES = 8.0, 0.3, (0.6, 0.006)
C10, C20 = 300.0, 150.0
PROTOCOL = f"""format = "explicitfe-protocol/1"
title = "Ramp and hold at two rates"
test = "compression"

[constants]
C10_Pa = {C10}
C20_Pa = {C20}

[specimen]
shape = "point"

[noise]
stress_sd_Pa = {SD_PA}
stretch_sd = 0.0

[[curve]]
id = "fast"
programme = [[0.0, 1.0], [0.5, 0.7], [60.0, 0.7]]
rows = 31

[[curve]]
id = "slow"
programme = [[0.0, 1.0], [50.0, 0.7], [60.0, 0.7]]
rows = 31
"""


def written(folder: Path, text: str = PROTOCOL) -> Path:
    path = folder / "protocol.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def designed(tmp_path_factory) -> PlannedTest:
    return design_test(written(tmp_path_factory.mktemp("design")), processes=1)


def row(planned: PlannedTest, effect: str) -> EffectInTest:
    return next(entry for entry in planned.effects if entry.effect == effect)


def curves(model: Yeoh, effects) -> np.ndarray:
    """Stress [Pa] of both tests; ten increments a row, and the corner."""
    parts = []
    for corner in (0.5, 50.0):
        rows = np.linspace(0.0, 60.0, 31)
        fine = np.unique(np.concatenate([np.linspace(0.0, 60.0, 301), [corner], np.linspace(0.0, corner, 40)]))
        stretch = np.interp(fine, [0.0, corner, 60.0], [1.0, 0.7, 0.7])
        parts.append(np.interp(rows, fine, point.uniaxial(model, effects, fine, stretch)))
    return np.concatenate(parts)


def test_the_smallest_share_that_shows_is_seen_at_25(designed):
    """The change by that share, of the best of the relaxation times, has |.|^2 = 25 beyond the constants. The strength
    coordinate -log(1 - g) is linear to a few percent from the trial to the answer, rows of 2 s cut the corner of the fast ramp,
    and increments are halved until they change less than 0.2 % of a peak of sixty times the noise: a fifth in |.|, a third in
    |.|^2.
    """
    effect_row = row(designed, "viscoelastic")
    assert effect_row.shows and effect_row.reason == "" and effect_row.strength == "viscoelastic.g"
    assert 0.0 < effect_row.smallest < 0.1 < effect_row.largest_plausible
    law = Yeoh(C10_Pa=C10, C20_Pa=C20, poisson=0.499)
    plain = curves(law, [])
    J = np.column_stack(
        [
            curves(law.model_copy(update={"C10_Pa": 1.001 * C10}), []) - plain,
            curves(law.model_copy(update={"C20_Pa": 1.001 * C20}), []) - plain,
        ]
    )
    J /= np.linalg.norm(J, axis=0)
    seen = []
    for tau in 60.0 * np.array(Viscoelastic.sought["tau_s"].values):
        d = curves(law, [Viscoelastic(g=(effect_row.smallest,), tau_s=(float(tau),))]) - plain
        d = d - J @ np.linalg.lstsq(J, d, rcond=None)[0]
        seen.append(float(d @ d) / SD_PA**2)
    assert max(seen) == pytest.approx(25.0, rel=0.33)


def test_twice_the_noise_needs_twice_the_strength(designed, tmp_path):
    """|secant|^2 goes with 1 / sd^2; the coordinate of a share is -log(1 - g).

    The prior of the strength is wider beside less noise by the factor 2, so that the decrease of chi2 that is needed there is
    larger by 2 log 2. It is about 25, so the strength is 3 per cent less than twice as large.
    """
    other = row(design_test(written(tmp_path, PROTOCOL.replace("= 8.0", "= 16.0")), processes=1), "viscoelastic")
    effect_row = row(designed, "viscoelastic")
    assert other.visible == pytest.approx(effect_row.visible / 4.0, rel=1e-6)
    assert 1.93 < np.log1p(-other.smallest) / np.log1p(-effect_row.smallest) <= 2.0


def test_what_a_protocol_cannot_show(designed):
    """Softening needs a way back, friction a tool; both say so. Rows come by what shows most."""
    for effect, word in (("softening", "unloading"), ("friction", "tool")):
        entry = row(designed, effect)
        assert not entry.shows and word in entry.reason
    visible = [entry.visible for entry in designed.effects]
    assert visible == sorted(visible, reverse=True)
    assert designed.n_eff == 62.0 and designed.constants == {"C10_Pa": C10, "C20_Pa": C20}


def test_the_table_says_what_is_told_apart_and_what_is_not():
    """Each strength has its name and unit; what the test tells apart never stands under what it does not."""
    own = {"shows": True, "largest_plausible": 2.29, "smallest": 1.15, "hides_in": {"C10_Pa": -0.09}}
    apart = {
        "effect": "compliance",
        "strength": "compliance.compliance_mm_N",
        "unit": "mm/N",
        "nearest": "layer",
        "separation": 78.3,
    }
    alike = {
        "effect": "layer",
        "strength": "layer.ratio",
        "cannot_tell_from": ["base-slip"],
        "nearest": "tilt",
        "separation": 31.0,
    }
    none = {"effect": "gravity", "strength": "gravity.acceleration_m_s2", "shows": False, "reason": "too weak (22 of 25)"}
    effects = [EffectInTest.model_validate(row) for row in (apart | own, alike | own, none)]
    planned = PlannedTest(protocol="eight steps", file="a.toml", n_eff=8.0, constants={}, effects=effects, runs=1)
    console = Console(width=200, file=io.StringIO())
    console.print(design_tables(planned))
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in console.file.getvalue().splitlines() if "│" in line]
    assert ["compliance", "compliance (mm/N)", "1.15", "2.29", "C10 -9 %"] in rows
    assert ["compliance", "", "layer", "78.3"] in rows
    assert ["layer", "ratio", "1.15", "2.29", "C10 -9 %"] in rows
    assert ["layer", "base-slip", "tilt", "31"] in rows
    assert ["gravity", "too weak (22 of 25)"] in rows


def test_what_is_nearest_is_told_apart(designed):
    """Of what shows, whatever is not told apart is in the list, and the nearest is not."""
    for entry in designed.effects:
        if entry.nearest is not None and entry.separation >= 25.0:
            assert entry.nearest not in entry.cannot_tell_from


def test_strengths_have_the_unit_that_their_effect_says():
    """As it stands in the description of the effect, such as "c (mm/kPa)"; an angle is linear in its square."""
    for name, effect in EFFECTS.items():
        described = re.search(r"\(([A-Za-z/^2]+)\)", effect.about.strength)
        if described and name != "tilt":
            _, unit = words_and_unit(next(iter(effect.sought)))
            assert unit == described[1].replace("^2", "²"), name
    assert words_and_unit("alpha_per_s") == ("alpha", "1/s") and words_and_unit("rate_mm_per_s") == ("rate", "mm/s")
    assert words_and_unit("k2") == ("k2", "") and words_and_unit("density_kg_m3") == ("density", "kg/m³")


def test_a_slow_test_without_a_hold_shows_no_relaxation(tmp_path):
    """One rate and no hold: time is not in the data at all."""
    text = PROTOCOL[: PROTOCOL.index("[[curve]]")]
    text += '[[curve]]\nid = "one"\nprogramme = [[0.0, 1.0], [10.0, 0.7]]\nrows = 20\n'
    entry = row(design_test(written(tmp_path, text), processes=1), "viscoelastic")
    assert not entry.shows and "a hold, or two rates" in entry.reason


def change(old: str, new: str) -> Callable[[str], str]:
    def changed(text: str) -> str:
        assert old in text
        return text.replace(old, new, 1)

    return changed


TOOL = change(
    'shape = "point"', 'shape = "cylinder"\n{size}\n[tool]\nshape = "sphere"\nradius_mm = 5.0\ncontrol = "displacement"'
)
BAD = [
    (change("explicitfe-protocol/1", "explicitfe-protocol/9"), ["explicitfe-protocol/1"]),
    (change("[constants]", "[constants"), ["not valid TOML"]),
    (change("C20_Pa", "C21_Pa"), ["C21_Pa", "C20_Pa"]),
    (change("C10_Pa = 300.0", "C10_Pa = -300.0"), ["C10_Pa"]),
    (change('test = "compression"', 'test = "torsion"'), ["torsion"]),
    (change('shape = "point"', 'shape = "cone"'), ["cone"]),
    (change("[specimen]", "[sample]"), ["sample"]),
    (change("stress_sd_Pa", "stress_Pa"), ["stress_Pa"]),
    (change("[0.5, 0.7]", "[0.0, 0.7]"), ['"fast"', "increasing times"]),
    (change("[[0.0, 1.0], [0.5", "[[0.1, 1.0], [0.5"), ['"fast"', "begin at 0 s"]),
    (change("[0.5, 0.7]", "[0.5, 0.7, 1.0]"), ["programme"]),
    (change("rows = 31", "rows = 2"), ["rows"]),
    (change("rows = 31", "rows = 1000000000"), ["rows", "10000"]),
    (change('title = "', 'title = "' + "x" * 900), ["title", "300"]),
    (change('id = "slow"', 'id = "fast"'), ["fast"]),
    (change("0.7], [60.0, 0.7]]", "70.0], [60.0, 70.0]]"), ["stretch"]),
    (change("programme = [[0.0, 1.0], [0.5, 0.7], [60.0, 0.7]]", "programme = [[0.0, 1.0], [60.0, 1.0]]"), ["fast"]),
    (change("rows = 31", "rows = 31\nspecimen = 3"), ["specimen"]),
    (lambda text: TOOL(text).replace("{size}", 'radius_mm = 20.0\nheight_mm = "high"'), ["height_mm"]),
    (lambda text: TOOL(text).replace("{size}", "").replace('"cylinder"', '"block"\nsize_mm = [30.0, 20.0]'), ["size_mm"]),
]


@pytest.mark.parametrize(("changed", "words"), BAD)
def test_a_protocol_that_cannot_be_used(changed, words, tmp_path, capsys):
    """Exit code 2 and one sentence that names the file and what is wrong."""
    path = written(tmp_path, changed(PROTOCOL))
    with pytest.raises(InputError) as caught:
        design_test(path, processes=1)
    sentence = str(caught.value)
    assert "\n" not in sentence and str(path) in sentence and sentence.endswith((".", "?")), sentence
    assert all(word in sentence for word in words), sentence
    assert command(["design-test", str(path), "--json"]) == 2
    failure = check_answer("design-test", capsys.readouterr().out)["failure"]
    assert failure == {"kind": "input", "message": sentence, "exit_code": 2}


def test_a_constant_that_is_left_out(tmp_path, designed):
    """C20 is 0 then, and its changes are shares of C10."""
    planned = design_test(written(tmp_path, PROTOCOL.replace(f"C20_Pa = {C20}\n", "")), processes=1)
    hides = [entry.hides_in for entry in planned.effects if entry.hides_in]
    assert hides and all(np.isfinite(list(changes.values())).all() for changes in hides)


def test_the_command_prints_one_object(tmp_path, capsys, designed):
    assert command(["design-test", str(written(tmp_path)), "--json"]) == 0
    printed = check_answer("design-test", capsys.readouterr().out)
    assert [entry["effect"] for entry in printed["effects"]] == [entry.effect for entry in designed.effects]
    assert command(["design-test", str(written(tmp_path))]) == 0
    assert "viscoelastic" in capsys.readouterr().out


def test_a_protocol_that_is_not_there(tmp_path):
    assert command(["design-test", str(tmp_path / "none.toml")]) == 2


LOADED_AND_UNLOADED = """format = "explicitfe-protocol/1"
title = "Force up and down"
test = "indentation"

[constants]
C10_Pa = 300.0
C20_Pa = 150.0

[specimen]
shape = "cylinder"
radius_mm = 20.0
height_mm = 12.0
base = "bonded"

[tool]
shape = "flat-cylinder"
radius_mm = 6.0
control = "force"

[noise]
force_sd_N = 0.0
displacement_sd_mm = 0.02

[[curve]]
id = "both-ways"
programme = [[0.0, 0.0], [10.0, 0.02], [20.0, 0.04], [30.0, 0.06], [40.0, 0.03], [50.0, 0.0]]
"""


@pytest.mark.parametrize("shipped", [False, True])
def test_a_protocol_that_begins_and_ends_at_zero_force(shipped, tmp_path):
    """No model determines where the tool is at zero force, so those rows are left out of the answer, not of the curve."""
    path = protocols()["gerard-2005"] if shipped else written(tmp_path, LOADED_AND_UNLOADED)
    protocol = design._read(path)
    simulator = Simulator(1)
    try:
        system = design._system(path, protocol, simulator)
        model = design._model(system, protocol)
        (answer,) = system.answers([model])
    finally:
        simulator.workers.close()
    rows = len(protocol.curve[0].programme)
    for curve, one, values in zip(system.curves, system.series, answer, strict=True):
        assert {len(column) for column in curve.columns.values()} == {rows}
        assert len(one.measured) == len(values) == rows - 2
        assert np.allclose(one.measured, values) and np.all(one.measured > 0.0)
