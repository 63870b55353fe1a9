"""The benchmark of hidden effects: its cases, its scorer, its rivals, and the solvers that only it has."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

STUDY = Path(__file__).resolve().parents[2] / "studies" / "hidden-effects"
sys.path.insert(0, str(STUDY))

# ruff: noqa: E402
import enter
import febio
import glued
import laws
import library
import make
import rivals
import score
from glued_solver import GluedCylinder, GluedSolver

from explicitfe.inverse.measured.read import read_dataset
from explicitfe.platform.errors import InputError
from studies.blind.foreign.law import HiddenTissue

ONLY_CONTROLS = {"control": 1.0}


def truth_entry(kind: str, causes: list[str], **more: object) -> dict[str, object]:
    return {
        "kind": kind,
        "setting": "homogeneous",
        "causes": causes,
        "accepts": [],
        "identifiable": True,
        "parameters": {},
    } | more


# ---- cases ----


def test_a_set_is_complete_and_is_not_made_twice(tmp_path):
    """Four controls in closed form: datasets that the program reads, the truth outside of them, and no second computation."""
    truth = make.make(tmp_path, 4, 3, {"closed": 1.0}, ONLY_CONTROLS)
    assert sorted(truth) == [f"case-000{k}" for k in (1, 2, 3, 4)]
    assert json.loads((tmp_path / "truth.json").read_text()) == truth
    for name, entry in truth.items():
        curves = read_dataset(tmp_path / name).curves
        assert sum(len(curve.time_s) for curve in curves) == entry["rows"]
        assert not any("truth" in path.name for path in (tmp_path / name).iterdir())
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("case-*/*")}
    (tmp_path / "case-0002" / "dataset.toml").unlink()
    (tmp_path / "case-0002" / "curve-1.csv").rename(tmp_path / "elsewhere.csv")
    for path in (tmp_path / "case-0002").iterdir():
        path.unlink()
    (tmp_path / "case-0002").rmdir()
    assert make.make(tmp_path, 4, 3, {"closed": 1.0}, ONLY_CONTROLS) == truth
    assert (tmp_path / "case-0002" / "curve-1.csv").read_text() == (tmp_path / "elsewhere.csv").read_text()
    for path, when in before.items():
        assert path.stat().st_mtime_ns == when or path.parent.name == "case-0002"
    with pytest.raises(InputError, match="another set"):
        make.make(tmp_path, 4, 4, {"closed": 1.0}, ONLY_CONTROLS)


def test_both_columns_carry_the_noise_that_the_truth_states(tmp_path):
    """White noise: the fourth differences of a hold's imposed rows have 70 times the stated variance."""
    truth = make.make(tmp_path, 6, 11, {"closed": 1.0}, ONLY_CONTROLS)
    ratios = []
    for name, entry in truth.items():
        for curve in read_dataset(tmp_path / name).curves:
            if "strain" not in entry["protocol"] and curve.tool is None:
                column = curve.columns[curve.imposed]
                hold = np.abs(np.gradient(column)) < 5.0 * entry["noise_rows"][1]
                steps = np.diff(column, 4)[hold[2:-2]]
                ratios += list(steps**2 / (70.0 * entry["noise_rows"][1] ** 2))
    assert len(ratios) > 100
    # Overlapping differences: a relative standard deviation of the mean of about sqrt(2 * 4 / n).
    assert abs(np.mean(ratios) - 1.0) < 4.0 * np.sqrt(8.0 / len(ratios))


def test_kinds_and_families_have_their_shares():
    requests = make.plan(550, 1, make.FAMILY_SHARES, make.KIND_SHARES)
    assert len(requests) == 550
    for family, share in make.FAMILY_SHARES.items():
        assert abs(sum(r.family == family for r in requests) - 550 * share) <= 1
    for kind, share in make.KIND_SHARES.items():
        assert abs(sum(r.kind == kind for r in requests) - 550 * share) <= len(make.FAMILY_SHARES)
    without = sum(r.family != "febio" for r in requests)
    assert without >= 500  # also where FEBio is not installed


def test_series_of_kernels_are_the_kernels():
    """A fractional Zener solid with alpha = 1/2 relaxes as exp(t / tau) erfc(sqrt(t / tau))."""
    from scipy.special import erfcx

    terms = laws.fractional_terms({"g": 1.0, "tau_s": 2.0, "alpha": 0.5})
    t = np.geomspace(1e-2, 1e3, 30)
    relaxed = sum(g * np.exp(-t / tau) for g, tau in terms)
    # What is slower than nine decades stays: half of the cut tail of the spectrum, 2 / pi e^(-reach / 2).
    reach = laws.SPECTRUM_DECADES * np.log(10.0)
    np.testing.assert_allclose(relaxed, erfcx(np.sqrt(t / 2.0)), atol=2.0 / np.pi * np.exp(-0.5 * reach) + 1e-6)


# ---- the spectral solver ----


def test_sliding_plates_are_the_homogeneous_state():
    """Neo-Hookean cylinder between plates that slide, in closed form with the volume free to change."""
    from scipy.optimize import brentq

    tissue = HiddenTissue(200.0)
    solver = GluedSolver(GluedCylinder(15.0, 20.0, glued=False), tissue, 3, 1)
    _, force = solver.advance(0.0, by_depth=True, target=4.0)
    K, c, along = float(solver.bulk[0]), 2e-4, 0.8

    def stresses(across: float) -> tuple[float, float]:
        """First Piola-Kirchhoff stress across and along, of c (I1 J^(-2/3) - 3) + K/4 (J^2 - 1 - 2 ln J)."""
        J = along * across**2
        I1 = (along**2 + 2.0 * across**2) * J ** (-2.0 / 3.0)
        p = 0.5 * K * (J - 1.0 / J)
        return tuple(2.0 * c * (J ** (-2.0 / 3.0) * x - I1 / (3.0 * x)) + p * J / x for x in (across, along))

    across = brentq(lambda x: stresses(x)[0], 1.0, 1.3, xtol=1e-14)
    assert force == pytest.approx(-np.pi * 15.0**2 * stresses(across)[1], rel=1e-9)


def test_derivatives_of_forces_are_exact():
    """Newton's method of the glued cylinder with relaxation and softening: stiffness against central differences."""
    tissue = HiddenTissue(200.0, 80.0, prony=((0.3, 5.0),), softening=(0.4, 1.0, 0.1))
    solver = GluedSolver(GluedCylinder(15.0, 20.0), tissue, 2, 1)
    solver.advance(0.1, by_depth=True, target=1.5)
    u = solver.u * 0.9
    rng = np.random.default_rng(0)
    direction = rng.standard_normal(len(u)) * 1e-6
    plus, minus = (solver._system(u + s * direction, 1.0)[0] for s in (1.0, -1.0))
    wanted = solver._system(u, 1.0)[1] @ direction
    np.testing.assert_allclose(0.5 * (plus - minus), wanted, atol=1e-6 * np.abs(wanted).max())


def test_a_held_force_creeps_to_the_long_term_law():
    """An imposed force on relaxing tissue ends at the depth of the elastic law with the constants that are left."""
    shape = GluedCylinder(15.0, 20.0)
    solver = GluedSolver(shape, HiddenTissue(200.0, prony=((0.3, 1.0),), poisson=0.45), 2, 1)
    depths = [solver.advance(t, by_depth=False, target=0.03)[0] for t in (0.01, 2.0, 6.0, 20.0, 60.0, 100.0, 140.0)]
    assert np.all(np.diff(depths[:5]) > 0.0)
    bulk = float(solver.bulk[0])
    soft = GluedSolver(shape, HiddenTissue(140.0, poisson=0.45), 2, 1)
    soft.bulk[:] = bulk  # the volume does not relax
    assert depths[-1] == pytest.approx(
        soft.advance(0.0, by_depth=False, target=0.03)[0], rel=1e-8
    )  # each long step leaves a hundredth


# ---- FEBio ----


def test_a_deck_has_the_sections_of_the_format_and_every_reference_exists():
    test = glued.GluedTest(GluedCylinder(15.0, 20.0), ((0.0, 0.0), (2.0, 1.0), (12.0, 1.0)), np.array([0.0, 2.0, 12.0]), 10.0)
    root = ET.fromstring(febio.deck(test, HiddenTissue(200.0, prony=((0.3, 5.0),), layer=(2.0, 3.0))))
    assert root.get("version") == "4.0"
    sections = ["Module", "Control", "Material", "Mesh", "MeshDomains", "Boundary", "LoadData", "Output"]
    assert [part.tag for part in root] == sections
    materials = {m.get("name") for m in root.iter("material")}
    parts = {e.get("name") for e in root.iter("Elements")}
    assert {d.get("mat") for d in root.iter("SolidDomain")} == materials
    assert {d.get("name") for d in root.iter("SolidDomain")} == parts
    sets = {s.get("name") for s in root.iter("NodeSet")}
    assert {bc.get("node_set") for bc in root.iter("bc")} == sets
    controllers = {c.get("id") for c in root.iter("load_controller")}
    assert {e.get("lc") for e in root.iter() if e.get("lc")} == controllers
    # FEBio's shares count from the long-term stress: G(t) = 1 + g1 e^(-t / t1).
    np.testing.assert_allclose([float(m.findtext("g1", "nan")) for m in root.iter("material")], 0.3 / 0.7, rtol=1e-8)


def test_the_mesh_of_a_deck_fills_a_quarter_of_the_cylinder():
    points, cells = febio.mesh(15.0, 20.0)
    a, b, d, e = (points[cells[:, k]] for k in (0, 1, 3, 4))
    assert (np.einsum("ei,ei->e", np.cross(b - a, d - a), e - a) > 0.0).all()  # the order of nodes is right-handed
    base, side = points[cells[:, :4]], points[cells[:, 4], 2] - points[cells[:, 0], 2]
    x, y = base[:, :, 0], base[:, :, 1]
    area = 0.5 * np.abs(np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1))
    polygon = np.pi * 15.0**2 / 4.0 * (1.0 - (np.pi / 4.0 / febio.CELLS) ** 2 / 6.0)  # chords of an arc, if they were equal
    assert np.sum(area * side) == pytest.approx(20.0 * polygon, rel=2e-3)


def test_reactions_of_a_quarter_make_the_force_of_the_plate():
    text = "*Step  = 1\n*Time  = 0.5\n*Data  = Rz\n1,-0.25\n2,-0.5\n*Step  = 2\n*Time  = 1\n*Data  = Rz\n1,-1\n2,-1\n"
    time_s, force_N = febio.read_forces(text)
    np.testing.assert_allclose(time_s, [0.0, 0.5, 1.0])
    np.testing.assert_allclose(force_N, [0.0, 3.0, 8.0])


def test_without_febio_its_cases_are_skipped(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("FEBIO", str(tmp_path / "none"))
    assert make.make(tmp_path / "set", 2, 1, {"febio": 1.0}, ONLY_CONTROLS, show=True) == {}
    assert "skipped: 2 cases of the family febio" in capsys.readouterr().out


# ---- scores ----


@pytest.mark.parametrize(
    ("kind", "causes", "answer", "word"),
    [
        ("control", [], {"verdict": "no-missing-effect"}, "silent"),
        ("control", [], {"verdict": "unexplained"}, "alarm"),
        ("single", ["relaxation"], {"verdict": "effect-found", "causes": ["power-law"]}, "right"),
        ("single", ["relaxation"], {"verdict": "effect-found", "causes": ["power-law", "lag"]}, "confidently wrong"),
        ("single", ["stiffness-over-depth"], {"verdict": "effect-found", "causes": ["inclusion"]}, "right"),
        ("single", ["lag"], {"verdict": "ambiguous", "causes": ["lag", "backlash"]}, "ambiguous, true named"),
        ("single", ["lag"], {"verdict": "no-missing-effect"}, "missed"),
        ("pair", ["lag", "softening"], {"verdict": "effect-found", "causes": ["softening"]}, "one"),
        ("pair", ["lag", "softening"], {"verdict": "effect-found", "causes": ["softening", "lag"]}, "right"),
        ("outside", [], {"verdict": "unexplained"}, "unexplained"),
        ("outside", [], {"verdict": "effect-found", "causes": ["lag"]}, "confidently wrong"),
        ("single", ["lag"], {"verdict": "failed"}, "failed"),
    ],
)
def test_outcomes(kind, causes, answer, word):
    assert score.outcome(answer, truth_entry(kind, causes)) == word


def test_a_relative_of_a_law_outside_the_library_describes_it():
    truth = truth_entry("outside", [], accepts=["relaxation"])
    assert score.outcome({"verdict": "effect-found", "causes": ["viscoelastic"]}, truth) == "described"
    assert score.outcome({"verdict": "effect-found", "causes": ["viscoelastic", "lag"]}, truth) == "confidently wrong"


def test_the_binomial_interval_is_that_of_clopper_and_pearson():
    """Table 24 of Documenta Geigy: 8 of 10 lie in [0.4439, 0.9748]."""
    np.testing.assert_allclose(score.binomial_interval(8, 10), (0.4439, 0.9748), atol=1e-4)
    assert score.binomial_interval(0, 10)[0] == 0.0
    assert score.binomial_interval(10, 10)[1] == 1.0


def test_a_table_counts_probabilities_and_intervals():
    truth = {f"case-{k}": truth_entry("single", ["lag"], parameters={"lag": {"lag_s": 0.1}}, C10_Pa=100.0) for k in range(6)}
    answer = {
        "verdict": "effect-found",
        "causes": ["lag"],
        "probabilities": [{"causes": ["lag"], "probability": 0.95}],
        "parameters": {"lag.lag_s": [0.05, 0.2], "C10_Pa": [101.0, 120.0]},
        "seconds": 3.0,
    }
    rows = score.column(dict.fromkeys(truth, answer), truth)
    assert rows["singles right, without a tool"] == "6/6"
    assert rows["95 % intervals that cover"] == "6/12 (50 %)"
    assert rows["right where the probability is 0.9 to 0.97"] == "6/6 [0.54, 1.00], stated 0.95, inside"
    assert rows["seconds, median (largest)"] == "3 (3)"


def test_an_entry_with_an_unknown_verdict_is_refused(tmp_path):
    path = tmp_path / "answers.json"
    path.write_text(json.dumps({"cases": {"case-1": {"verdict": "sure"}}}))
    with pytest.raises(ValueError, match="case-1: verdict = 'sure'"):
        score.read_answers(path, ["case-1"])


def test_a_report_becomes_an_answer():
    """Forms of one cause add their probabilities."""
    report = {
        "verdict": "effect-found",
        "effects": ["power-law"],
        "posterior": {"power-law": 0.5, "viscoelastic": 0.3, "nothing": 0.1, "other": 0.05, "viscoelastic + lag": 0.05},
        "final": {"parameters": {"C10_Pa": {"value": 1.0, "ci95": [0.9, 1.1]}, "power-law.tau_s": {"value": 1.0}}},
    }
    answer = enter.answer_of(report)
    assert answer["causes"] == ["relaxation"]
    assert answer["probabilities"][0] == {"causes": ["relaxation"], "probability": 0.8}
    assert {"causes": ["something-else"], "probability": 0.05} in answer["probabilities"]
    assert answer["parameters"] == {"C10_Pa": [0.9, 1.1]}


# ---- rivals ----


def regression(seed: int, *, strong: bool) -> library.Library:
    """Twelve correlated columns of six effects, two of which make the data."""
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((200, 12)) + 0.2 * rng.standard_normal((200, 1))
    constants = rng.standard_normal((200, 2))
    y = constants @ [3.0, -2.0] + rng.standard_normal(200)
    if strong:
        y = y + 4.0 * X[:, 2] + 3.0 * X[:, 7]
    columns = [library.Column(f"effect-{k // 2}", (float(k),)) for k in range(12)]
    return library.Library(y, constants, X, columns, np.arange(200) // 50)


def test_every_rival_selects_the_columns_that_made_the_data():
    data = regression(1, strong=True)
    for name, support in rivals.supports(data).items():
        assert {2, 7} <= set(support), name
    assert set(rivals.supports(data)["omp-bic"]) == {2, 7}


def test_the_lasso_path_is_the_optimum_at_each_breakpoint():
    """Coordinate descent without negative coefficients has the same supports in the same order, from large penalties on."""
    data = regression(2, strong=True)
    X, y = (rivals.outside_constants(data.constants, part) for part in (data.X, data.y))
    Z = X / np.linalg.norm(X, axis=0)
    path = rivals.lasso(X, y)
    found = []
    for penalty in np.geomspace(1.001, 1e-2, 200) * (Z.T @ y).max():
        w = np.zeros(Z.shape[1])
        for _ in range(60):
            for k in range(len(w)):
                c = Z[:, k] @ (y - Z @ w) + w[k]
                w[k] = max(c - penalty, 0.0)
        support = set(np.flatnonzero(w).tolist())
        if not found or support != found[-1]:
            found.append(support)
        if len(support) > 4:
            break
    assert [set(step) for step in path[: len(found) - 1]] == found[:-1]


def test_bic_selects_fewer_columns_than_aic_on_noise():
    sizes = {"aic": 0, "bic": 0}
    for seed in range(20):
        found = rivals.supports(regression(100 + seed, strong=False))
        for by in sizes:
            sizes[by] += len(found[f"omp-{by}"])
    assert sizes["bic"] < sizes["aic"]


@pytest.mark.slow
def test_rivals_answer_a_case(tmp_path):
    """A control in closed form: the library is built, and each rival answers."""
    make.make(tmp_path, 1, 3, {"closed": 1.0}, ONLY_CONTROLS)
    answers = rivals.answers_to(tmp_path / "case-0001")
    assert len(answers) == 13
    assert {answer["verdict"] for answer in answers.values()} <= set(score.VERDICTS) - {"failed"}
