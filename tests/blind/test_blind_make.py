"""The generator of blind cases and the scorer: numerics, files that are written, and which effects are called identifiable."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from explicitfe.inverse.measured.curve import Curve
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.inverse.measured.tables import MeasuredNoise, MeasuredSpecimen, MeasuredTool
from explicitfe.inverse.predict.experiment import experiments
from explicitfe.inverse.predict.predict import predict_test
from explicitfe.inverse.predict.tissue import Tissue
from explicitfe.platform.errors import InputError
from studies.blind import tables, under_a_tool
from studies.blind.case import CaseRequest, write
from studies.blind.closed_forms import Bench
from studies.blind.grid import HomogeneousRun, Mode
from studies.blind.identifiable import SMALLEST_IDENTIFIABLE_DISTANCE, separation
from studies.blind.make import make, numbers, plan
from studies.blind.noise import Noise, Whitener
from studies.blind.outcome import WORDS, intervals, outcome
from studies.blind.protocols import programme
from studies.blind.score import score

pytestmark = pytest.mark.slow

C10, C20 = 400.0, 300.0
AREA_M2, HEIGHT_M = 7e-4, 0.02
RELAXING = {"viscoelastic": {"g": [0.3], "tau_s": [5.0]}}
SOFTENING = {"softening": {"inverse_r": 0.5, "m_Pa": 30.0}}
CORNERS = ((0.0, 0.0), (3.0, 1.0), (30.0, 1.0), (33.0, 0.0), (50.0, 0.0))


def planned(mode: Mode, largest: float, **more) -> HomogeneousRun:
    """A ramp, a hold, unloading and rest; ``largest`` is a strain, an amount of shear or a displacement [m]."""
    time_s, share = programme(CORNERS, 90)
    size = {"height_m": HEIGHT_M, "area_m2": AREA_M2} if mode == "platen" else {}
    return HomogeneousRun("c", time_s, 1.0 + largest * share if mode == "uniaxial" else largest * share, **size, **more)


def as_measured(plan: Sequence[HomogeneousRun], mode: Mode) -> list[Curve]:
    """The planned curves as the package reads them."""
    first, second = {
        "uniaxial": ("stretch", "nominal_stress_Pa"),
        "shear": ("shear_strain", "shear_stress_Pa"),
        "platen": ("displacement_m", "force_N"),
    }[mode]
    specimen, tool = MeasuredSpecimen(shape="point"), None
    if mode == "platen":
        radius_mm = 1e3 * float(np.sqrt(AREA_M2 / np.pi))
        specimen = MeasuredSpecimen(shape="cylinder", radius_mm=radius_mm, height_mm=1e3 * HEIGHT_M, base="frictionless")
        tool = MeasuredTool(shape="platen", control="displacement", friction=0.0)
    kind = "force-displacement" if mode == "platen" else mode
    return [
        Curve(
            id=f"{k}",
            file=f"{k}.csv",
            kind=kind,
            constants="all",
            group="one",
            split=None,
            specimen=specimen,
            tool=tool,
            noise=MeasuredNoise(),
            conditions=curve.conditions,
            time_s=curve.time_s,
            columns={first: curve.imposed, second: np.zeros_like(curve.imposed)},
        )
        for k, curve in enumerate(plan)
    ]


def by_package(plan: Sequence[HomogeneousRun], mode: Mode, effects: dict) -> np.ndarray:
    model = Tissue.model_validate({"constants": {"C10_Pa": C10, "C20_Pa": C20}, "effects": effects})
    values = {}
    for test in experiments(as_measured(plan, mode)):
        values |= {curve.id: p.values for curve, p in zip(test, predict_test(test, model), strict=True)}
    return np.concatenate([values[str(k)] for k in range(len(plan))])


# ---- the generator's numerics ----


def test_closed_forms():
    """Incompressible Yeoh: P = 2 W' (l - l^-2) in compression and tension, 2 W' k in shear; F = -A P between platens."""
    for strain in (-0.35, 0.6):
        curve = planned("uniaxial", strain)
        stretch = curve.imposed
        slope = C10 + 2.0 * C20 * (stretch**2 + 2.0 / stretch - 3.0)
        values = Bench([curve], "uniaxial", poisson=0.5).values(C10, C20)
        np.testing.assert_allclose(values, 2.0 * slope * (stretch - stretch**-2), rtol=1e-10, atol=1e-9)
    curve = planned("shear", 0.7)
    k = curve.imposed
    np.testing.assert_allclose(Bench([curve], "shear").values(C10, C20), 2.0 * (C10 + 2.0 * C20 * k**2) * k, atol=1e-9)


def test_relaxation_at_a_held_stretch():
    """After a hold of many times tau the stress is 1 - g of the elastic one; in shear at small strain that is exact."""
    time_s = np.concatenate([np.linspace(0.0, 0.1, 11), 0.1 + np.geomspace(0.1, 200.0, 60)])
    curve = HomogeneousRun("c", time_s, 1e-3 * np.minimum(time_s / 0.1, 1.0))
    bench = Bench([curve], "shear")
    whole, left = bench.values(C10, 0.0), bench.values(C10, 0.0, RELAXING)
    assert left[-1] / whole[-1] == pytest.approx(0.7, abs=1e-6)
    half = np.interp(5.0 + 0.05, time_s, left / np.maximum(whole, 1e-12))
    assert half == pytest.approx(1.0 - 0.3 * (1.0 - np.exp(-1.0)), abs=2e-3)


@pytest.mark.parametrize(
    ("mode", "largest", "effects", "tolerance"),
    [
        ("uniaxial", -0.35, {}, 1e-6),
        ("uniaxial", 0.5, SOFTENING, 1e-6),
        ("uniaxial", -0.3, RELAXING, 1e-3),
        ("uniaxial", -0.3, {"third-yeoh": {"C30_Pa": 300.0}}, 1e-6),
        ("shear", 0.7, RELAXING | SOFTENING, 1e-3),
        ("platen", 5e-3, {"contact-offset": {"offset_mm": 0.4}}, 3e-3),
        ("platen", 5e-3, {"force-offset": {"offset_N": 0.05}, "force-drift": {"rate_N_s": 0.001}}, 3e-3),
    ],
)
def test_agrees_with_the_package(mode, largest, effects, tolerance):
    """Within a share of the peak; it is larger for platens, as the package interpolates them between instants."""
    plan = [planned(mode, largest)]
    ours, theirs = Bench(plan, mode).values(C10, C20, effects), by_package(plan, mode, effects)
    assert np.abs(ours - theirs).max() < tolerance * np.abs(theirs).max()


def test_incompressible_is_within_the_difference_of_poissons_ratio():
    plan = [planned("uniaxial", -0.35)]
    ours, theirs = Bench(plan, "uniaxial", poisson=0.5).values(C10, C20), by_package(plan, "uniaxial", {})
    assert 1e-5 < np.abs(ours - theirs).max() / np.abs(theirs).max() < 3e-3


def test_fibres_cycles_and_repeats_agree_with_the_package():
    fibres = {"fibres": {"k1_Pa": 800.0, "k2": 2.0}}
    plan = [planned("uniaxial", -0.28, conditions={"direction": d}, test=k) for k, d in enumerate(("fibre", "cross-fibre"))]
    np.testing.assert_allclose(Bench(plan, "uniaxial").values(C10, C20, fibres), by_package(plan, "uniaxial", fibres), atol=1e-4)
    plan = [planned("uniaxial", strain, conditions={"cycle": k + 1}) for k, strain in enumerate((-0.2, -0.3))]
    ours, theirs = Bench(plan, "uniaxial").values(C10, C20, RELAXING), by_package(plan, "uniaxial", RELAXING)
    assert np.abs(ours - theirs).max() < 1e-3 * np.abs(theirs).max()
    drift = {"cycle-drift": {"per_cycle": 0.05}}
    plan = [planned("uniaxial", -0.2, conditions={"repeat": k + 1}, test=k) for k in range(3)]
    values = np.split(Bench(plan, "uniaxial").values(C10, C20, drift), 3)
    np.testing.assert_allclose(values[2], 1.10 * values[0], rtol=1e-12)


def test_tissue_that_a_platen_left_agrees_with_the_package():
    """Tissue unloaded faster than it recovers, and loaded again; the package interpolates between instants."""
    time_s, share = programme(((0.0, 0.0), (3.0, 1.0), (6.0, 0.0), (9.0, 1.0), (20.0, 1.0)), 120)
    plan = [HomogeneousRun("c", time_s, 6e-3 * share, height_m=HEIGHT_M, area_m2=AREA_M2)]
    effects = {"viscoelastic": {"g": [0.6], "tau_s": [2.0]}}
    bench = Bench(plan, "platen")
    ours, theirs = bench.values(C10, C20, effects), by_package(plan, "platen", effects)
    largest = np.abs(theirs).max()
    assert np.abs(ours - theirs).max() < 4e-3 * largest
    assert np.abs(ours - bench.values(C10, C20, effects, recovers=False)).max() > 5e-3 * largest


def test_compliance_is_in_series():
    """d = d_tool + c F, and F is that of the rigid rig at d_tool."""
    curve = planned("platen", 5e-3)
    force = Bench([curve], "platen").values(C10, C20, {"compliance": {"compliance_mm_N": 0.6}})
    tool = HomogeneousRun("t", curve.time_s, curve.imposed - 0.6e-3 * force, height_m=HEIGHT_M, area_m2=AREA_M2)
    np.testing.assert_allclose(Bench([tool], "platen").values(C10, C20), force, atol=1e-8)


def test_noise_is_whitened():
    """Rows with correlated noise and scatter become independent ones of unit variance."""
    rng = np.random.default_rng(0)
    curve = np.linspace(0.0, 100.0, 60)
    for noise in (Noise(0.01, 1.0, rho=0.8), Noise(0.01, 1.0, rho=0.5, scale_sd=0.1, offset_sd=2.0)):
        whiten = Whitener(noise, [curve, curve], [True, False])
        rows = np.array([whiten(np.concatenate([noise.add_to(rng, [curve])[0] - curve, curve])) for _ in range(2000)])
        covariance = rows.T @ rows / len(rows)
        assert rows.shape[1] == len(curve)
        # a sample's entries scatter by about sqrt(2 / n)
        assert np.abs(covariance - np.eye(len(curve))).max() < 6.0 * np.sqrt(2.0 / len(rows))


# ---- what is identifiable ----


def apart(effects: dict) -> float:
    bench = Bench([planned("shear", 0.6), planned("shear", 0.3, test=1)], "shear")
    true = bench.values(C10, C20, effects, 3)
    whiten = Whitener(Noise(0.01, 0.01 * float(np.abs(true).max())), bench.curves(true), [True, True])
    distances = separation(bench, true, whiten, (C10, C20), list(effects))
    assert distances.identifiable == (min(distances.baseline, *distances.rivals.values()) >= SMALLEST_IDENTIFIABLE_DISTANCE)
    assert all(distance <= distances.baseline for distance in distances.rivals.values())
    return min(distances.baseline, *distances.rivals.values())


def test_a_strong_effect_is_identifiable_and_a_vanishing_one_is_not():
    assert apart(RELAXING) > 10.0 * SMALLEST_IDENTIFIABLE_DISTANCE
    assert apart({"viscoelastic": {"g": [1e-4], "tau_s": [5.0]}}) < 1.0
    assert apart(SOFTENING) > 10.0 * SMALLEST_IDENTIFIABLE_DISTANCE


# ---- what is written ----


def contents(folder: Path) -> dict[str, str]:
    return {str(path.relative_to(folder)): path.read_text() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("blind") / "study"
    make(out, seed=5, kinds={"control": 4, "outside": 1})
    return out


def test_datasets_read_back_and_tell_nothing(study):
    folders = sorted((study / "cases").iterdir())
    assert [path.name for path in folders] == [f"case-{k:04d}" for k in range(1, 6)]
    for folder in folders:
        dataset = read_dataset(folder)
        truth = json.loads((study / "sealed" / f"{folder.name}.json").read_text())
        assert dataset.name == truth["case"] == folder.name
        assert 3 <= len(dataset.curves) <= 6
        text = (folder / "dataset.toml").read_text().lower()
        # "control" stands in every [tool]: it is what the machine imposed
        words = {truth["kind"], truth["sub"], *truth["outside"], "identifiable", "seed", "truth", "c10"} - {"control"}
        assert not [word for word in words if word in text]
        stated = dataset.curves[0].noise
        known = [value for value in (stated.stress_sd_Pa, stated.force_sd_N) if value is not None]
        assert bool(known) == truth["noise"]["stated"]
        assert known == [] or known[0] == pytest.approx(truth["noise"]["sd"], rel=1e-5)


def test_the_seed_decides(tmp_path):
    for name, seed in (("one", 5), ("same", 5), ("other", 6)):
        make(tmp_path / name, seed=seed, kinds={"control": 4})
    assert contents(tmp_path / "same" / "cases") == contents(tmp_path / "one" / "cases")
    assert contents(tmp_path / "other" / "cases") != contents(tmp_path / "one" / "cases")


def test_kinds_are_balanced():
    wanted = plan(1, {"single": 90}, "homogeneous")
    counts = {(w.subjects, w.level) for w in wanted}
    assert len(counts) == 27
    assert {sum(w.subjects == what for w in wanted) for what, _ in counts} == {10}
    assert sum(numbers(100, None, "homogeneous").values()) == 100
    with pytest.raises(InputError, match="double"):
        numbers(None, {"double": 1}, "indentation")


def test_an_indentation_reads_back(tmp_path, monkeypatch):
    """A control on a coarse mesh, to save time. Most of it is compiling, the first time on a machine."""
    monkeypatch.setattr(under_a_tool, "DATA_MESH", under_a_tool.SCREENING_MESH)
    case = under_a_tool.draw(np.random.default_rng(1), CaseRequest("control", ("wrong-dimension",), 0.01))
    write(case, tmp_path / "case", "case-0001")
    dataset = read_dataset(tmp_path / "case")
    wrong = case.truth["wrong"]
    assert wrong["key"] in getattr(dataset.curves[0], wrong["where"]).assumed
    assert all(30 <= len(curve.time_s) <= 60 for curve in dataset.curves)


# ---- the scorer ----

TRUTH = {"kind": "single", "effects": {"viscoelastic": {"g": [0.3], "tau_s": [2.0]}}, "C10_Pa": 100.0, "C20_Pa": 50.0}


@pytest.mark.parametrize(
    ("verdict", "effects", "more", "word"),
    [
        ("effect-found", ["viscoelastic"], [], "right"),
        ("effect-found", ["softening"], [], "confidently wrong"),
        ("effect-found", ["viscoelastic", "softening"], [], "confidently wrong"),
        ("ambiguous", ["softening"], ["viscoelastic"], "ambiguous, true named"),
        ("ambiguous", ["softening"], ["drainage"], "ambiguous, true not named"),
        ("no-missing-effect", [], [], "missed"),
        ("unexplained", [], [], "unexplained"),
        ("failed", [], [], "failed"),
    ],
)
def test_outcome_of_a_single(verdict, effects, more, word):
    assert outcome({"verdict": verdict, "effects": effects, "ambiguous_with": more}, TRUTH) == word


def test_outcomes_of_other_kinds():
    two = TRUTH | {"kind": "double", "effects": {"viscoelastic": {}, "friction": {}}}
    report = {"verdict": "effect-found", "effects": ["friction"], "remainder": "at-floor"}
    assert outcome(report, two) == "one, said to be all"
    assert outcome(report | {"remainder": "unexplained"}, two) == "one, remainder says so"
    assert outcome(report | {"effects": ["friction", "viscoelastic"]}, two) == "both"
    beyond = TRUTH | {"kind": "outside", "effects": {}, "noise": {"sd": 1.0, "rho": 0.0}, "rows": {"a": 100}}
    curve = {"split": "holdout", "rmse": 1.0}
    assert outcome(report | {"final": {"error": {"curves": {"a": curve}}}}, beyond) == "an effect that predicts at the floor"
    assert outcome(report | {"final": {"error": {"curves": {"a": curve | {"rmse": 2.0}}}}}, beyond) == "confidently wrong"
    relaxing = TRUTH | {"kind": "single", "effects": {"viscoelastic": {}}}
    assert outcome(report | {"effects": ["power-law"]}, relaxing) == "right"  # another form of the same mechanism
    assert outcome(report, beyond | {"sub": "friction"}) == "named"  # The library has learnt it since.
    assert outcome({"verdict": "ambiguous"}, {"kind": "control"}) == "ambiguous"
    for kind in WORDS:
        assert outcome(report | {"verdict": "limited-by-numerics"}, TRUTH | {"kind": kind}) == "limited-by-numerics"


def test_intervals():
    entry = {"value": 1.0, "ci95": [90.0, 110.0]}
    parameters = {"C10_Pa": {"all": entry}, "viscoelastic.g": {"value": 0.2, "ci95": [0.1, 0.2]}}
    rows = {row["name"]: row for row in intervals({"final": {"parameters": parameters}}, TRUTH)}
    assert rows["C10_Pa"]["covers"] and rows["C10_Pa"]["width"] == pytest.approx(0.2)
    assert not rows["viscoelastic.g"]["covers"]


def test_proportions():
    """For 0 of 10 the upper end of the interval is 1 - 0.025^(1/10)."""
    none = tables.proportion(0, 10)
    assert none["ci95"] == pytest.approx([0.0, 1.0 - 0.025**0.1])


def test_score_with_reports_that_are_there(study):
    """A case with a report is not run again; the tables count the verdicts of the reports."""
    for path in (study / "cases").iterdir():
        report = study / "reports" / path.name / "report.json"
        report.parent.mkdir(parents=True)
        report.write_text(json.dumps({"verdict": "unexplained", "effects": [], "remainder": "unexplained"}))
    result = score(study)
    assert result["tables"]["headline"]["false alarms in controls"]["count"] == 4
    assert result["tables"]["outside the library"]["all"]["unexplained"]["share"] == 1.0
    assert "100.0 %" in (study / "score.md").read_text()
    assert (study / "confusion.png").stat().st_size > 5000
    assert json.loads((study / "score.json").read_text()) == result


def test_a_case_that_cannot_be_run_is_a_failure(study):
    """A crash does not stop the other cases, and the score gives its reason."""
    (study / "cases" / "case-0001" / "dataset.toml").unlink()
    (study / "reports" / "case-0001" / "report.json").unlink()
    cases = {row["case"]: row for row in score(study)["cases"]}
    assert cases["case-0001"]["outcome"] == "failed"
    assert "Error" in cases["case-0001"]["problem"]
    assert cases["case-0002"]["outcome"] != "failed"
