"""Datasets made by the simulator, predicted by their own model; effects of the measurement; instants; what is refused."""

from __future__ import annotations

import json
from functools import cache, partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from effects_fit import Unknown, fit_effects, series
from identify_cases import write, write_homogeneous

from explicitfe.app.api.inverse import predict
from explicitfe.fem.effects.material.fibres import Fibres
from explicitfe.fem.effects.material.viscoelastic import Viscoelastic
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import point
from explicitfe.inverse.measured.course import bends, course_of
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.inverse.predict.experiment import effects_of, experiments
from explicitfe.inverse.predict.predict import predict_test
from explicitfe.inverse.predict.tissue import EVERY, Constants, Numerics, Tissue, parse_tissue, read_tissue
from explicitfe.platform.errors import InputError, RunError
from explicitfe.results.documents.prediction import Prediction

pytestmark = pytest.mark.slow

COARSE = 0.7
YEOH = {"C10_Pa": 300.0, "C20_Pa": 150.0}
PRONY = Viscoelastic(g=(0.4, 0.2), tau_s=(0.5, 20.0))
RATE, STRAIN = 0.05, 0.3


def model(*effects, **tables) -> Tissue:
    tissue = Tissue(constants={EVERY: Constants(**YEOH)}, **tables)
    for effect in effects:
        tissue = tissue.with_effect(effect)
    return tissue


def saved(folder: Path, tissue: Tissue | str) -> Path:
    path = folder / "model.toml"
    path.write_text(tissue if isinstance(tissue, str) else tissue.text, encoding="utf-8")
    return path


# ---- homogeneous ----


def muscle(folder: Path, rows: int = 24, conditions: str = "") -> Path:
    """A ramp and hold whose corner lies between two rows, computed on instants a hundred times as fine."""
    t = np.concatenate([np.linspace(0.0, 5.9, rows // 2), np.geomspace(6.3, 300.0, rows // 2)])
    fine = np.unique(np.concatenate([np.linspace(0.0, 12.0, 4001), np.geomspace(12.0, 300.0, 200), t, [STRAIN / RATE]]))
    stretch = 1.0 - np.minimum(RATE * fine, STRAIN)
    law = Yeoh(**YEOH, poisson=0.499)
    stress = point.uniaxial(law, [PRONY], fine, stretch)[np.searchsorted(fine, t)]
    return _timed(
        write_homogeneous(folder, "compression", "stretch,nominal_stress_Pa", np.interp(t, fine, stretch), stress), t, conditions
    )


def _timed(path: Path, t: np.ndarray, conditions: str) -> Path:
    file = path / "one.csv"
    head, *rows = file.read_text(encoding="utf-8").splitlines()
    rows = [f"{time:.12g},{row.split(',', 1)[1]}" for time, row in zip(t, rows, strict=True)]
    file.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    if conditions:
        with (path / "dataset.toml").open("a", encoding="utf-8") as text:
            text.write(f"conditions = {{ {conditions} }}\n")
    return path


def test_a_curve_is_predicted_by_its_own_model(tmp_path):
    """Halving the increments changes less than 0.2 % of the peak, so the curve is nearer than that to one without increments."""
    data = muscle(tmp_path / "data")
    prediction = predict(data, saved(tmp_path, model(PRONY)))
    curve = prediction.curves["one"]
    assert np.abs(np.subtract(curve.rows.predicted, curve.rows.measured)).max() < 2e-3 * curve.largest_measured
    assert curve.nrmse == pytest.approx(curve.rmse / curve.largest_measured)
    assert (curve.quantity, curve.unit, curve.imposed) == ("nominal_stress", "Pa", "stretch")
    assert prediction.document["error"]["all"] == {"curves": 1, "nrmse": curve.nrmse}
    assert curve.seconds < 30.0


def test_without_the_corner_of_its_programme_the_curve_would_be_off(tmp_path):
    """Between rows a programme is straight. With too few rows on a ramp its corner is not found, and the relaxation is missed."""
    plain = muscle(tmp_path / "plain", rows=6)
    rows = predict(plain, saved(tmp_path, model(PRONY))).curves["one"].rows
    assert np.abs(np.subtract(rows.predicted, rows.measured)).max() > 4e-3 * np.abs(rows.measured).max()


def test_fibres_lie_as_the_curve_says():
    def direction(conditions: dict, *given: float) -> tuple[float, ...]:
        fibres = Fibres(k1_Pa=100.0, direction=given or (0.0, 0.0, 1.0))
        return effects_of(SimpleNamespace(id="c", tool=None, conditions=conditions), model(fibres))[0].direction

    assert direction({"direction": "cross-fibre"}) == (1.0, 0.0, 0.0)
    assert direction({"direction": "fibre"}, 0.0, 1.0, 0.0) == (0.0, 0.0, 1.0)
    assert direction({}, 0.0, 1.0, 0.0) == (0.0, 1.0, 0.0)


def test_a_fit_finds_what_a_curve_was_made_with(tmp_path):
    """No noise: the constants come back within the accuracy of the curve."""
    data = muscle(tmp_path / "data", conditions=f"rate_per_s = {RATE}, max_strain = {STRAIN}")
    curves = read_dataset(data).curves
    remaining = 1.0 - sum(PRONY.g)
    truth = {
        "C10": remaining * 300.0,
        "C20": remaining * 150.0,
        "s0": 0.4 / remaining,
        "s1": 0.2 / remaining,
        "t0": 0.5,
        "t1": 20.0,
    }

    def make(v):
        sudden = 1.0 + v["s0"] + v["s1"]
        constants = Constants(C10_Pa=sudden * v["C10"], C20_Pa=sudden * v["C20"])
        return Tissue(constants={EVERY: constants}).with_effect(series([v["s0"], v["s1"]], [v["t0"], v["t1"]]))

    unknowns = {name: Unknown(1e-3 * value, 1e3 * value, 1.5 * value) for name, value in truth.items()}
    fit = fit_effects(curves, unknowns, make, lambda cs, m: [predict_test([c], m)[0].values for c in cs], starts=1)
    assert fit.values == pytest.approx(truth, rel=0.05)
    assert not fit.at_bound
    assert fit.nrmse["one"] < 2e-3


# ---- under a tool ----

DEEP_M = 4e-3


@cache
def programme() -> tuple[np.ndarray, np.ndarray]:
    """Ramp, hold, quick retraction to a gap: rows at 5 Hz."""
    t = np.arange(0.0, 24.01, 0.2)
    return t, np.interp(t, [0.0, 8.0, 16.0, 20.0, 24.0], [0.0, DEEP_M, DEEP_M, -0.5e-3, -0.5e-3])


def indentation(folder: Path, *, lines: str = "", copies: int = 1) -> Path:
    """A dataset whose forces are of no importance."""
    t, d = programme()
    names = [f"curve-{k}" for k in range(copies)]
    dataset = write(folder, {n: (d, 1.0 + t) for n in names}, control="displacement", more={n: lines for n in names})
    for name in names:
        _timed_tool(dataset / f"{name}.csv", t)
    return dataset


def _timed_tool(file: Path, t: np.ndarray) -> None:
    head, *rows = file.read_text(encoding="utf-8").splitlines()
    rows = [f"{time:.12g},{row.split(',', 1)[1]}" for time, row in zip(t, rows, strict=True)]
    file.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")


def curve_of(path: Path):
    return read_dataset(path).curves[0]


@pytest.fixture(scope="module")
def soft(tmp_path_factory):
    """Forces of the viscoelastic tissue, by density of the instants."""
    curve = curve_of(indentation(tmp_path_factory.mktemp("soft") / "data"))
    return {n: predict_test([curve], model(PRONY), refinement=COARSE, density=n)[0] for n in (1.0, 2.0)}


def test_instants_suffice(soft):
    """Half the increments change the curve by less than 0.2 % of its peak, contact and loss of contact included."""
    once, twice = soft[1.0].values, soft[2.0].values
    assert np.abs(once - twice).max() < 2e-3 * twice.max()
    assert soft[1.0].instants < 60
    assert soft[1.0].iterations < soft[2.0].iterations


def test_a_tool_that_has_left_bears_nothing(soft):
    t, d = programme()
    force = soft[1.0].values
    assert (force[t >= 20.0] == 0.0).all()
    assert (force[(t > 0.5) & (d > 0.7 * DEEP_M)] > 0.0).all()
    # It relaxes in the hold, and unloading lies below loading.
    hold = (t >= 8.0) & (t <= 16.0)
    assert (np.diff(force[hold]) < 0.0).all()
    back = (t > 16.0) & (t < 20.0)
    assert np.interp(2e-3, d[back][::-1], force[back][::-1]) < force[np.argmin(np.abs(t - 4.0))]


def test_readings_are_exact(tmp_path, soft):
    """An offset of the cell, its drift and that of the repeats lie on the same forces; so does a shifted displacement."""
    readings = parse_tissue(
        model(PRONY).text
        + "force-offset = { offset_N = 0.1 }\nforce-drift = { rate_N_s = 0.01 }\ncycle-drift = { per_cycle = -0.1 }\n"
    )
    curve = curve_of(indentation(tmp_path / "data", lines="conditions = { repeat = 3 }"))
    read = predict_test([curve], readings, refinement=COARSE)[0].values
    # Effects apply in the order of their table: drift of the cell, its offset, then the factor of the repeat.
    assert read == pytest.approx((soft[1.0].values + 0.01 * curve.time_s + 0.1) * 0.8, abs=1e-12)


def test_offset_of_contact_is_a_shift_of_the_first_row(tmp_path):
    """The elastic force at d + d0: what is read at d, for either sign of d0."""
    curve = curve_of(indentation(tmp_path / "data"))
    plain = predict_test([curve], model(), refinement=COARSE)[0].values
    t, d = programme()
    ramp = t <= 8.0
    for offset in (0.4, -0.4):
        shifted = parse_tissue(model().text + f"[effects]\ncontact-offset = {{ offset_mm = {offset} }}\n")
        shifted_values = predict_test([curve], shifted, refinement=COARSE)[0].values[ramp]
        inside = d[ramp] + 1e-3 * offset <= DEEP_M
        expected = np.interp(d[ramp] + 1e-3 * offset, d[ramp], plain[ramp], left=0.0)
        assert np.abs(shifted_values - expected)[inside].max() < 5e-3 * plain.max()
        assert (shifted_values[0] > 0.0) == (offset > 0.0)


def test_force_that_is_imposed_gives_the_displacement_back(tmp_path, soft):
    """What the displacement test answers, imposed as a force in the ramp, gives its displacement."""
    t, d = programme()
    rows = (t <= 8.0) & (t > 0.5)
    dataset = write(tmp_path / "data", {"one": (d[rows], soft[1.0].values[rows])}, control="force")
    _timed_tool(dataset / "one.csv", t[rows] - t[rows][0])
    # The first row presses already: the tool came there at the pace of the rows that follow, as in the ramp.
    values = predict_test([curve_of(dataset)], model(PRONY), refinement=COARSE)[0].values
    assert np.abs(values - d[rows])[5:].max() < 0.01 * DEEP_M


def test_numerics_of_the_model_file_are_used(tmp_path, soft):
    """The model's own where nothing else is asked for; none are written where all are the usual ones."""
    curve = curve_of(indentation(tmp_path / "data"))
    coarse = model(PRONY, numerics=Numerics(refinement=COARSE))
    assert np.array_equal(predict_test([curve], parse_tissue(coarse.text))[0].values, soft[1.0].values)
    dense = predict_test([curve], model(PRONY, numerics=Numerics(refinement=0.1, density=2.0)), refinement=COARSE)[0]
    assert np.array_equal(dense.values, soft[2.0].values)
    assert "refinement = 0.7\n" in coarse.text and "density" not in coarse.text
    assert "numerics" not in model(PRONY).text
    with pytest.raises(InputError, match=r"refinement = 0\.0 is not possible"):
        predict_test([curve], coarse, refinement=0.0)


def test_in_parallel_as_one_by_one(tmp_path, soft):
    data = indentation(tmp_path / "data", copies=3)
    path = saved(tmp_path, model(PRONY))
    prediction = predict(data, path, refinement=COARSE, processes=2, out=tmp_path / "out")
    for curve in prediction.curves.values():
        assert np.array_equal(curve.rows.predicted, soft[1.0].values)
    text = (tmp_path / "out" / "predict.json").read_text(encoding="utf-8")
    assert Prediction.model_validate_json(text) == prediction
    assert json.loads(text) == prediction.document
    assert len((tmp_path / "out" / "curve-1.csv").read_text(encoding="utf-8").splitlines()) == 1 + len(programme()[0])
    # The file states how it was computed: it alone makes the prediction again.
    assert read_tissue(tmp_path / "out" / "model.toml") == model(PRONY, numerics=Numerics(refinement=COARSE))
    assert (prediction.refinement, prediction.density, prediction.tolerance) == (COARSE, 1.0, 1e-4)
    with pytest.raises(InputError, match="earlier prediction"):
        predict(data, path, refinement=COARSE, out=tmp_path / "out")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "mine.txt").touch()
    with pytest.raises(InputError, match="other files"):
        predict(data, path, out=tmp_path / "other")


def test_what_is_not_reached_is_said_and_the_rest_goes_on(tmp_path, monkeypatch):
    """The status of a curve that the simulator cannot follow is "failed", with a sentence."""
    from explicitfe.inverse.predict import predict as module

    def broken(test, *_, **__):
        raise RunError(f"{test[0].id} breaks")

    monkeypatch.setattr(module, "predict_test", broken)
    data = muscle(tmp_path / "data")
    prediction = predict(data, saved(tmp_path, model()))
    assert prediction.failures == {"one": "one breaks"}
    curve = prediction.document["curves"]["one"]
    assert curve["status"] == "failed"
    assert "predicted" not in curve["rows"]
    assert not curve.keys() & {"rmse", "nrmse", "instants"}
    assert prediction.error == {}


def test_cycles_of_one_specimen_are_one_test(tmp_path):
    t, d = programme()
    more = {name: f"group = 'a'\nconditions = {{ cycle = {number} }}" for name, number in (("late", 2), ("early", 1))}
    data = write(tmp_path / "data", dict.fromkeys(more, (d, 1.0 + t)), control="displacement", more=more)
    assert [[c.id for c in test] for test in experiments(read_dataset(data).curves)] == [["early", "late"]]


# ---- between platens ----

PLATEN = """format = "explicitfe-dataset/1"
name = "platen"
title = "Made"
test = "compression"
[specimen]
shape = "cylinder"
radius_mm = 10.0
height_mm = 12.0
base = "frictionless"
[tool]
shape = "platen"
control = "displacement"
friction = 0.0
[[curve]]
id = "one"
file = "one.csv"
"""
SERIES = "viscoelastic = { g = [0.4, 0.2], tau_s = [0.5, 20.0] }\n"


@pytest.fixture(scope="module")
def pressed(tmp_path_factory):
    """Ramp, hold, off, and soon in again: contact is lost before the tool is back, and found late."""
    folder = tmp_path_factory.mktemp("platen")
    t = np.linspace(0.0, 30.0, 100)
    d = np.interp(t, [0.0, 8.0, 16.0, 20.0, 21.0, 26.0, 30.0], [0.0, 4.0, 4.0, -0.3, -0.3, 4.0, 0.0])
    rows = "".join(f"{a:.12g},{b:.12g},1\n" for a, b in zip(t, d, strict=True))
    (folder / "one.csv").write_text(f"time_s,displacement_mm,force_N\n{rows}", encoding="utf-8")
    (folder / "dataset.toml").write_text(PLATEN, encoding="utf-8")
    return read_dataset(folder).curves[0]


@pytest.mark.parametrize(
    ("effects", "density"),
    [
        ("compliance = { compliance_mm_N = 2.0 }\n", 1.0),
        ("preload = { force_N = 0.05 }\n", 1.0),
        (SERIES, 3.0),
        (SERIES + "compliance = { compliance_mm_N = 2.0 }\n", 1.0),
        (SERIES + "compliance = { compliance_mm_N = 1.0 }\npreload = { force_N = 0.05 }\n", 3.0),
    ],
)
def test_platens_as_the_simulator_has_them(pressed, monkeypatch, effects, density):
    """The homogeneous state and finite elements, to 0.1 % of the peak; these need denser instants to find contact again."""
    from explicitfe.inverse.predict import under_a_tool as module

    tissue = parse_tissue(model().text + "[effects]\n" + effects)
    exact = predict_test([pressed], tissue, density=density)[0]
    assert exact.iterations == 0
    monkeypatch.setattr(module, "is_uniform", lambda setup: False)
    meshed = predict_test([pressed], tissue, density=density, tolerance=1e-5)[0]
    assert meshed.iterations > 0
    assert np.abs(exact.values - meshed.values).max() < 1e-3 * meshed.values.max()


def test_a_rig_that_gives_way_shifts_an_elastic_curve(pressed):
    """d = d_tool + c F exactly: on the ramp the force at d is that of the stiff rig at d - c F."""
    stiff = parse_tissue(model().text)
    soft = parse_tissue(stiff.text + "[effects]\ncompliance = { compliance_mm_N = 2.0 }\n")
    ramp = pressed.time_s < 8.0
    force = predict_test([pressed], soft)[0].values
    shortening = pressed.displacement_m - 2e-3 * force
    answer = -1e-6 * pressed.specimen.face_mm2 * point.uniaxial(stiff.law(pressed), (), pressed.time_s, 1.0 - shortening / 12e-3)
    # Between instants the curve is interpolated.
    assert np.abs(answer - force)[ramp].max() < 1e-3 * force.max()


def test_where_no_homogeneous_state_is_found_the_simulator_goes_on(pressed, monkeypatch):
    from explicitfe.inverse.predict.platens import Platens

    def none(self, course):
        raise RunError("not found")

    exact = predict_test([pressed], model())[0].values
    monkeypatch.setattr(Platens, "follow", none)
    meshed = predict_test([pressed], model())[0]
    assert meshed.iterations > 0
    assert np.abs(meshed.values - exact).max() < 1e-3 * exact.max()


# ---- instants ----


def test_bends_of_a_programme():
    t, d = programme()
    assert t[bends(t, d, 1e-6)] == pytest.approx([0.0, 8.0, 16.0, 20.0, 24.0])
    course = course_of(t, d)
    assert course.time_s[course.bends] == pytest.approx([0.0, 8.0, 16.0, 20.0, 24.0])
    assert course.at(course.imposed, t) == pytest.approx(d, abs=1e-9)
    still = course_of(t, d, waits=False)
    assert len(still.time_s) < len(course.time_s)
    early = course_of(t, d + 1e-3)
    assert (early.time_s[0], early.imposed[0]) == (pytest.approx(-2.0), 0.0)
    late = course_of(t, d - 1e-3)
    assert 0.0 in late.imposed[1:]
    assert late.time_s[late.imposed == 0.0] == pytest.approx([2.0])


def test_loss_of_contact_is_found_between_instants():
    """F = (1 - t)^1.5 until 1, nothing after: with instants 0.1 apart that miss the end, to 1 % of the largest."""
    t = np.linspace(0.0, 2.0, 20)
    course = course_of(t, 3.0 - t, waits=True)
    force = np.maximum(1.0 - course.time_s, 0.0) ** 1.5
    fine = np.linspace(0.0, 2.0, 300)
    assert np.abs(course.at(force, fine, 1.5) - np.maximum(1.0 - fine, 0.0) ** 1.5).max() < 0.01


# ---- model files ----


def test_a_model_file_comes_back_exactly(tmp_path):
    tissue = parse_tissue(
        """
        format = "explicitfe-model/1"
        title = 'a "quoted" \\ title'
        poisson = 0.49
        constants_by = "direction"
        constants.fibre = { C10_Pa = 0.1, C20_Pa = 1e-17 }
        constants."across it" = { C10_Pa = 123456789.123456789 }
        effects.viscoelastic = { g = [0.1, 0.3333333333333333], tau_s = [1, 20.0] }
        effects.contact-offset = { offset_mm = -0.25 }
        effects.preload = { force_N = 0.01 }
        tool = { radius_mm = 4.5 }
        specimen.base = "bonded"
        numerics = { refinement = 0.3, density = 2, tolerance = 3.3333333333333333e-5 }
        """
    )
    (tmp_path / "model.toml").write_text(tissue.text, encoding="utf-8")
    assert read_tissue(tmp_path / "model.toml") == tissue
    assert read_tissue(tmp_path / "model.toml").text == tissue.text


HEAD = 'format = "explicitfe-model/1"\n'
SOFT = HEAD + "[constants]\nC10_Pa = 1.0\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[constants]\nC10_Pa = 1.0\n", 'the key "format" is missing'),
        (HEAD, 'the key "constants" is missing'),
        (HEAD + "[constants]\n", "must be a table with C10_Pa"),
        (HEAD + "[constants]\nC10_Pa = -1.0\n", r"C10_Pa = -1.0 is not possible"),
        (HEAD + "[constants]\nC20_Pa = 1.0\n", 'the key "C10_Pa" is missing'),
        (HEAD + '[constants]\nC10_Pa = "2"\n', "C10_Pa = '2' is not possible"),
        (SOFT + "[effects]\nviskoelastic = { g = [0.1], tau_s = [1.0] }\n", 'did you mean "viscoelastic"'),
        (SOFT + "[effects]\nviscoelastic = { g = [1.1], tau_s = [1.0] }\n", "add up to less than 1"),
        (HEAD + "poisson = 0.5\n[constants]\nC10_Pa = 1.0\n", "poisson = 0.5"),
        (HEAD + "constants = 1\n", "must be a table"),
        (SOFT + "[numerics]\nrefinment = 2.0\n", 'did you mean "refinement"'),
        (SOFT + "[numerics]\ntolerance = 0.1\n", "numerics.tolerance = 0.1 is not possible"),
        ("format = \n", "not valid TOML"),
    ],
)
def test_bad_model_files_are_refused_in_a_sentence(tmp_path, text, message):
    path = saved(tmp_path, text)
    with pytest.raises(InputError, match=message) as error:
        read_tissue(path)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)


def test_what_does_not_go_with_the_dataset_is_refused(tmp_path):
    data = muscle(tmp_path / "data")
    run = partial(predict, data)
    other = Tissue(constants={"fibre": Constants(C10_Pa=100.0)})
    with pytest.raises(InputError, match=r'no \[constants.all\], which curve "one" needs'):
        run(saved(tmp_path, other))
    with pytest.raises(InputError, match=r"replaces keys of \[tool\]"):
        run(saved(tmp_path, model(tool={"radius_mm": 3.0})))
    with pytest.raises(InputError, match=r'\[specimen\] of the model: unknown key "radus_mm"'):
        run(saved(tmp_path, model(specimen={"radus_mm": 3.0})))
    with pytest.raises(InputError, match='there is no curve "two"'):
        run(saved(tmp_path, model()), curves=["two"])
    with pytest.raises(InputError, match="cannot be read"):
        run(tmp_path / "none.toml")
    with pytest.raises(InputError, match="needs a tool"):
        run(saved(tmp_path, model().text + "[effects]\nfriction = { coefficient = 0.1 }\n"))
