"""``identify`` as a whole: constants from data made with other numerics, what it says, what it writes, what it refuses."""

from __future__ import annotations

import io
import json
import tomllib
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from answers import check_answer
from identify_cases import COARSE, LOADS_N, TRUTH, response, setup, write, write_homogeneous
from rich.console import Console

from explicitfe.app.api.inverse import identify
from explicitfe.app.api.write_identification import slugs_of
from explicitfe.app.view.json_text import json_text
from explicitfe.app.view.terminal.identify import identification_notes, identification_tables
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import point
from explicitfe.inverse.identify import forward
from explicitfe.inverse.identify.assumptions import Alternative, alternatives, what_a_fit_hides
from explicitfe.inverse.identify.fit import least_squares_fit
from explicitfe.inverse.identify.forward import FIRST_Q, CurveModel, ToolResponse
from explicitfe.inverse.identify.observed import Observed
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.inverse.measured.select import loading_rows, select
from explicitfe.inverse.predict.setup import Setup
from explicitfe.platform.errors import InputError, MachineError, RunError
from explicitfe.results.documents.fitted_curves import ConstantProfile
from explicitfe.simulate.scenario.indentation import IndentationScenario
from explicitfe.simulate.scenario.read import read_scenario

pytestmark = pytest.mark.slow

MORE_LOADS_N = np.array([0.1, 0.2, 0.35, 0.5, 0.7])


def smooth_curve(loads_N: np.ndarray = LOADS_N, constants=TRUTH) -> tuple[np.ndarray, np.ndarray]:
    return response().at_force(loads_N, *constants)[0], loads_N


@pytest.fixture(scope="module")
def quarter() -> tuple[np.ndarray, np.ndarray]:
    """Data of a quarter mesh, finer and with another tolerance than the fit's."""
    body = setup(refinement=0.75, symmetry="quarter").relaxation(*TRUTH, tolerance=1e-5)
    return np.array([body.press(float(load)).displacement_m for load in MORE_LOADS_N]), MORE_LOADS_N


@pytest.fixture(scope="module")
def identified(quarter, tmp_path_factory):
    folder = tmp_path_factory.mktemp("identify")
    stages: list[tuple[str, float]] = []
    data = write(folder / "data", {"one": quarter})
    identification = identify(
        data, out=folder / "out", refinement=COARSE, progress=lambda stage, share: stages.append((stage, share))
    )
    return identification, stages, folder


def test_constants_come_back_from_other_numerics(identified):
    """No inverse crime: the meshes differ by up to 1 % of a displacement, which moves C10 by 3 and C20 by 8 % at most."""
    identification = identified[0]
    constants = identification["groups"]["all"]["constants"]
    assert constants["C10_Pa"]["value"] == pytest.approx(TRUTH[0], rel=0.03)
    assert constants["C20_Pa"]["value"] == pytest.approx(TRUTH[1], rel=0.08)
    for entry in constants.values():
        assert entry["ci95"][0] < entry["value"] < entry["ci95"][1]
    assert identification["groups"]["all"]["error"]["fit"]["nrmse"] < 0.01


def test_progress_never_goes_back_and_ends(identified):
    stages = identified[1]
    assert stages[0][0] in ("load", "compile")
    shares = [share for stage, share in stages if stage == "identify"]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert len(shares) > 20


def test_what_is_written(identified):
    identification, _, folder = identified
    names = {path.name for path in (folder / "out").iterdir()}
    assert names == {"identify.json", "identify.html", "fit.png", "profiles.png", "deformed.png", "fitted.toml", "material.toml"}
    assert {Path(path).name for path in identification["files"]} == names
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]
    stored = json.loads((folder / "out" / "identify.json").read_text())
    assert stored["groups"] == json.loads(json.dumps(identification["groups"]))
    material = tomllib.loads((folder / "out" / "material.toml").read_text())["all"]
    assert material["C10_Pa"] == pytest.approx(identification["groups"]["all"]["constants"]["C10_Pa"]["value"], rel=1e-5)


def test_names_of_groups_as_names_of_files():
    """No two groups share a file, also where capitals are small letters; a name of any length is one that a file can have."""
    slugs = slugs_of(["A/B", "A-B", "a b", "?", "!", "x" * 500, "x" * 501])
    assert list(slugs.values())[:5] == ["A-B", "A-B-2", "a-b-3", "group", "group-2"]
    assert max(map(len, slugs.values())) < 70 and len(set(slugs.values())) == len(slugs)


def test_written_scenario_repeats_the_test(identified):
    """The scenario is one that ``explicitfe run`` takes; the forces are those of the dataset."""
    scenario, _ = read_scenario(identified[2] / "out" / "fitted.toml")
    assert isinstance(scenario, IndentationScenario)
    assert scenario.analysis.forces_N == pytest.approx(MORE_LOADS_N)
    assert scenario.tool.rounding_mm == 2.0


def test_tables_for_people(identified):
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(identification_tables(identified[0]))
    text = console.export_text()
    for word in ("C10", "C20", "sticking contact", "simulations", "law", "shear modulus"):
        assert word in text
    notes = list(identification_notes(identified[0]))
    assert any("sticking contact" in note or "layer" in note or "gravity" in note for note in notes)


def test_same_again(identified):
    """No seed, no clock: bit by bit the same."""
    identification, _, folder = identified
    assert identify(folder / "data", refinement=COARSE)["groups"] == identification["groups"]


def test_paper_method(quarter, tmp_path):
    identification = identify(write(tmp_path / "data", {"one": quarter}), method="paper", out=tmp_path / "out", refinement=COARSE)
    check_answer("identify", json_text(identification))
    group = identification["groups"]["all"]
    assert group["status"] == "converged"
    assert group["constants"]["C10_Pa"]["value"] == pytest.approx(TRUTH[0], rel=0.04)
    assert all(group["paper"]["within"])
    assert group["paper"]["trace"][0]["changed"] == "start"
    assert (tmp_path / "out" / "convergence.png").is_file()


def test_what_a_fit_hides_is_what_a_refit_finds():
    """The table's constants under a layer, against a fit of the same data with a response of that test.

    A run of 12 depths on this coarse mesh is smooth to 6e-3 of its forces, which four loads make some 3 percent of C10.
    """
    depths, loads = smooth_curve()
    seen = Observed("simulated", loads, depths, 0.0, 1e-5, CurveModel(response(), True))
    fit = least_squares_fit([seen], profile=False)
    other = Setup(setup().specimen | {"layer_mm": 2.0, "layer_stiffness_ratio": 3.0}, setup().tool, 0.499, 1040.0)
    layered = ToolResponse(other, response().depths_m[-1])
    layered.add([*FIRST_Q, 0.2])
    truth = least_squares_fit([Observed("simulated", loads, depths, 0.0, 1e-5, CurveModel(layered, True))], profile=False)
    hidden, _ = what_a_fit_hides(setup(), [seen], fit, [Alternative("layer", other)])
    moved = truth.constants / fit.constants - 1.0
    assert moved[0] < -0.05
    assert hidden[0].change[0] == pytest.approx(moved[0], abs=0.04)


def test_questions_fit_the_test(tmp_path):
    """What is assumed is asked about; what cannot be otherwise is not."""
    data = read_dataset(write(tmp_path / "data", {"one": smooth_curve()}))
    names = [a.name for a in alternatives(setup(), data.curves[0])]
    assert names == [
        "sticking contact",
        "a surface layer of 1 mm, 3 times as stiff",
        "Poisson's ratio 0.49",
        "the tool's edge rounded by 1 mm",
        "gravity",
    ]


# ---- homogeneous data ----


def test_homogeneous_compression(tmp_path):
    stretch = np.linspace(1.0, 0.7, 20)
    stress = point.uniaxial(Yeoh(C10_Pa=500.0, C20_Pa=200.0), (), np.zeros(len(stretch)), stretch)
    data = write_homogeneous(tmp_path / "data", "compression", "stretch,nominal_stress_Pa", stretch, stress, "stress_sd_Pa = 1.0")
    identification = identify(data, out=tmp_path / "out", poisson=0.499)
    constants = identification["groups"]["all"]["constants"]
    assert constants["C10_Pa"]["value"] == pytest.approx(500.0, rel=1e-4)
    assert constants["C20_Pa"]["value"] == pytest.approx(200.0, rel=1e-3)
    assert identification["forward_runs"] == 0
    assert identification["groups"]["all"]["hides"] == []
    assert not (tmp_path / "out" / "fitted.toml").exists()


def test_what_is_printed_and_drawn_is_as_wide_as_the_residual_asks_for(tmp_path, monkeypatch):
    """A material that stiffens otherwise than Yeoh's law: the residual is many times the noise, and goes up and down slowly."""
    stretch = np.linspace(1.0, 0.7, 60)
    stress = point.uniaxial(Yeoh(C10_Pa=500.0, C20_Pa=200.0), (), np.zeros(len(stretch)), stretch)
    stress = stress * (1.0 + 0.1 * np.sin(20.0 * stretch))
    data = write_homogeneous(tmp_path / "data", "compression", "stretch,nominal_stress_Pa", stretch, stress, "stress_sd_Pa = 1.0")
    drawn: list[ConstantProfile] = []
    monkeypatch.setattr(import_module("explicitfe.app.view.fit"), "profiles", lambda path, title, rows: drawn.extend(rows))
    identification = identify(data, out=tmp_path / "out")
    group = identification["groups"]["all"]
    assert group["widened_by"] > 10.0
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(identification_tables(identification))
    text = console.export_text()
    for name, row in zip(("C10_Pa", "C20_Pa"), drawn, strict=True):
        constant = group["constants"][name]
        low, high = constant["ci95"]
        assert high - low > 5.0 * np.ptp(constant["ci95_of_noise"])
        assert f"{low:.5g} to {high:.5g}" in text and row["ci95"] == pytest.approx((low, high))
        assert row["values"][0] <= max(low, 1e-3) and row["values"][-1] >= high
        assert f"{constant['ci95_of_noise'][0]:.5g}" not in text
    assert "times wider than from independent noise alone" in text


def test_homogeneous_shear_without_noise_stated(tmp_path):
    amount = np.linspace(0.0, 0.5, 15)
    stress = point.shear(Yeoh(C10_Pa=500.0, C20_Pa=0.0), (), np.zeros(len(amount)), amount) * (1.0 - 0.2 * amount**2)
    identification = identify(write_homogeneous(tmp_path / "data", "shear", "shear_strain,shear_stress_Pa", amount, stress))
    group = identification["groups"]["all"]
    # 500 (1 - 0.2 gamma^2) gamma is Yeoh's law with C20 = -50 Pa exactly, as I1 - 3 = gamma^2.
    assert group["at_bound"] == []
    assert group["constants"]["C20_Pa"]["value"] == pytest.approx(-50.0, rel=1e-6)
    assert group["noise"] == "estimated from the residual"
    assert any("does not state the noise" in warning for warning in group["warnings"])


# ---- which curves, which rows ----


def test_only_loading_is_used(tmp_path):
    depths, loads = smooth_curve()
    up_and_down = np.concatenate([depths, depths[::-1] * 1.1]), np.concatenate([loads, loads[::-1] * 0.9])
    data = read_dataset(write(tmp_path / "data", {"one": up_and_down}))
    assert loading_rows(data.curves[0]) == len(loads)


def test_selection(tmp_path):
    curves = {name: smooth_curve() for name in "abcde"}
    more = {
        "a": 'group = "one"\nconditions = { sample = "A", digitisation = 1 }',
        "b": 'group = "one"\nconditions = { sample = "A", digitisation = 2 }',
        "c": 'conditions = { sample = "B", defect = "slipped" }',
        "d": 'conditions = { sample = "C" }\nsplit = "holdout"',
        "e": 'conditions = { sample = "D" }',
    }
    data = read_dataset(write(tmp_path / "data", curves, more=more))
    groups, left_out = select(data, ())
    assert [c.id for c in groups[0].fitted] == ["a", "e"]
    assert [c.id for c in groups[0].predicted] == ["d"]
    assert left_out == {"c": "defect: slipped", "b": 'a second digitisation of "a"'}
    groups, _ = select(data, ["sample=A"])
    assert [c.id for c in groups[0].fitted] == ["a"]
    assert [c.id for c in groups[0].predicted] == ["d", "e"]
    groups, _ = select(data, ["sample=A", "sample=D"])
    assert [c.id for c in groups[0].fitted] == ["a", "e"]


@pytest.mark.parametrize(
    ("fit_where", "sentence"),
    [
        (["sample"], "write KEY=VALUE"),
        (["sampel=A"], 'no curve has the condition "sampel"; did you mean "sample"'),
        (["sample=Q"], 'no curve has sample = "Q"'),
        (["sample=B"], 'no curve remains to fit the constants "all"'),
    ],
)
def test_selection_that_cannot_be(tmp_path, fit_where, sentence):
    more = {"a": 'conditions = { sample = "A" }', "b": 'conditions = { sample = "B" }\nsplit = "holdout"'}
    data = write(tmp_path / "data", {"a": smooth_curve(), "b": smooth_curve()}, more=more)
    with pytest.raises(InputError, match=sentence.replace("(", r"\(")):
        identify(data, fit=fit_where)


# ---- refusals, and what stays untouched ----


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"method": "papr"}, 'did you mean "paper"'),
        ({"poisson": 0.51}, "`poisson` 0.51"),
        ({"poisson": 0.4999}, "elements under a tool need a value of at most 0.4995"),
        ({"refinement": 0.0}, "`refinement` 0"),
        ({"constants_by": "sample"}, 'cannot be grouped by "sample"'),
    ],
)
def test_bad_options(tmp_path, options, sentence):
    with pytest.raises(InputError, match=sentence):
        identify(write(tmp_path / "data", {"one": smooth_curve()}), **options, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_paper_needs_force_steps(tmp_path):
    depths, loads = smooth_curve()
    with pytest.raises(InputError, match="needs force steps"):
        identify(write(tmp_path / "moved", {"one": (depths, loads)}, control="displacement"), method="paper")
    many = np.linspace(0.001, 0.7, 150)
    with pytest.raises(InputError, match="a record in time"):
        identify(write(tmp_path / "long", {"one": smooth_curve(many)}), method="paper")


def test_pulling_is_refused(tmp_path):
    depths, loads = smooth_curve()
    data = write(tmp_path / "data", {"one": (-depths, -loads)}, control="displacement")
    with pytest.raises(InputError, match="the tool pulls only"):
        identify(data)


def test_failing_forward_model_leaves_nothing(tmp_path, monkeypatch):
    def stuck(*_, **__):
        raise RunError("the forward model stops at 1 mm.")

    monkeypatch.setattr(forward, "forces", stuck)
    with pytest.raises(RunError, match="stops at 1 mm"):
        identify(write(tmp_path / "data", {"one": smooth_curve()}), out=tmp_path / "out", refinement=COARSE)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data"]


def test_out_folder_is_safe(tmp_path):
    """Another's folder is never touched, one's own only when that is asked for; a file is refused."""
    stretch = np.linspace(1.0, 0.8, 8)
    stress = point.uniaxial(Yeoh(C10_Pa=500.0, C20_Pa=200.0), (), np.zeros(len(stretch)), stretch)
    data = write_homogeneous(tmp_path / "data", "compression", "stretch,nominal_stress_Pa", stretch, stress, "stress_sd_Pa = 1.0")
    taken = tmp_path / "taken"
    taken.mkdir()
    (taken / "thesis.txt").write_text("years of work")
    with pytest.raises(InputError, match="contains other files"):
        identify(data, out=taken, overwrite=True)
    assert (taken / "thesis.txt").read_text() == "years of work"
    with pytest.raises(InputError, match="is a file"):
        identify(data, out=taken / "thesis.txt")
    (tmp_path / "empty").mkdir()
    identify(data, out=tmp_path / "empty")
    with pytest.raises(InputError, match="earlier identification"):
        identify(data, out=tmp_path / "empty")
    identify(data, out=tmp_path / "empty", overwrite=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data", "empty", "taken"]


def test_picture_that_fails_leaves_the_old_folder(tmp_path, monkeypatch):
    stretch = np.linspace(1.0, 0.8, 8)
    stress = point.uniaxial(Yeoh(C10_Pa=500.0, C20_Pa=200.0), (), np.zeros(len(stretch)), stretch)
    data = write_homogeneous(tmp_path / "data", "compression", "stretch,nominal_stress_Pa", stretch, stress, "stress_sd_Pa = 1.0")
    identify(data, out=tmp_path / "out")
    before = (tmp_path / "out" / "identify.json").read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(import_module("explicitfe.app.view.fit"), "profiles", full)
    with pytest.raises(MachineError, match="No space left"):
        identify(data, out=tmp_path / "out", overwrite=True)
    assert (tmp_path / "out" / "identify.json").read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data", "out"]
