"""From a dataset on disk to a verdict, a report and a model file that reproduces it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from answers import check_answer
from command import command

from explicitfe.app.api.inverse import close_loop, predict
from explicitfe.inverse.close_loop.specimens.simulator import Simulator
from explicitfe.inverse.close_loop.specimens.specimens import Specimens
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.results.documents.loop_report import LoopReport

pytestmark = pytest.mark.slow

C10, C20, G, TAU_S = 300.0, 150.0, 0.4, 1.0
STRAIN, RATES, ROWS, SHARE = 0.3, (0.02, 0.1, 0.5), 30, 0.01
FILES = {"report.json", "report.html", "model.toml", "baseline.toml"}


def stress(t: np.ndarray, rate: float, g: float, tau_s: float = TAU_S, fine: int = 3000) -> np.ndarray:
    """Nominal stress [Pa] of an incompressible Yeoh solid with one Prony term in a compression ramp: of the isochoric second
    Piola-Kirchhoff stress S, along and across, 1 - g is left at once, and Q of it fades as dQ/dt + Q / tau = g dS/dt (Simo
    1987), exact for an S that is linear over a step; the pressure makes the side free of stress.
    """
    s = np.unique(np.concatenate([np.linspace(0.0, t[-1], fine), t]))
    stretch = 1.0 - rate * s
    I1 = stretch**2 + 2.0 / stretch
    slope = C10 + 2.0 * C20 * (I1 - 3.0)
    kept = []
    for S in (2.0 * slope * (1.0 - I1 / (3.0 * stretch**2)), 2.0 * slope * (1.0 - I1 * stretch / 3.0)):
        step = np.diff(s) / tau_s
        Q = np.zeros(len(s))
        for k in range(1, len(s)):
            Q[k] = np.exp(-step[k - 1]) * Q[k - 1] - g * (S[k] - S[k - 1]) * np.expm1(-step[k - 1]) / step[k - 1]
        kept.append((1.0 - g) * S + Q)
    return np.interp(t, s, stretch * kept[0] - kept[1] / stretch**2)


def written(
    folder: Path, *, g: float = G, seed: int = 1, rates=RATES, lines: Callable[[int], str] = lambda k: "", noise: bool = True
) -> Path:
    """Ramps at several rates, with noise of one percent."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(seed)
    sd = SHARE * float(np.abs(stress(np.array([0.0, STRAIN / rates[-1]]), rates[-1], g)).max())
    text = 'format = "explicitfe-dataset/1"\nname = "ramps"\ntitle = "Ramps"\ntest = "compression"\n'
    text += '[specimen]\nshape = "point"\n[noise]\n' + (f"stress_sd_Pa = {sd:.6g}\nstretch_sd = 0.0\n" if noise else "")
    for k, rate in enumerate(rates):
        t = np.linspace(0.0, STRAIN / rate, ROWS)
        y = stress(t, rate, g) + sd * rng.standard_normal(ROWS)
        rows = "".join(f"{a:.9g},{1.0 - rate * a:.9g},{b:.9g}\n" for a, b in zip(t, y, strict=True))
        (folder / f"ramp-{k}.csv").write_text(f"time_s,stretch,nominal_stress_Pa\n{rows}", encoding="utf-8")
        text += f'[[curve]]\nid = "ramp-{k}"\nfile = "ramp-{k}.csv"\n{lines(k)}\n'
    (folder / "dataset.toml").write_text(text, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def closed(tmp_path_factory) -> tuple[Path, Path, LoopReport]:
    """Dataset, folder of the report, the report."""
    base = tmp_path_factory.mktemp("loop")
    data = written(base / "data")
    return data, base / "out", close_loop(data, out=base / "out", processes=1)


def test_a_hidden_relaxation_is_found(closed):
    """Strength and time come back inside their 95 % intervals widened to four standard errors, as do C10 and C20."""
    _, _, report = closed
    assert (report.verdict, report.effects, report.remainder) == ("effect-found", ["viscoelastic"], "at-floor")
    assert report.split.fit == ["ramp-0", "ramp-2"] and report.split.holdout == ["ramp-1"]
    final = report.final.parameters
    truths = {"viscoelastic.g": G, "viscoelastic.tau_s": TAU_S}
    entries = [(final[name], truth) for name, truth in truths.items()]
    entries += [(final["C10_Pa"]["all"], C10), (final["C20_Pa"]["all"], C20)]
    for entry, truth in entries:
        low, high = entry.ci95
        assert low - (entry.value - low) < truth < high + (high - entry.value), entry


def test_errors_before_and_after(closed):
    """Afterwards the fitted curves are off by the noise, 1 % of the fastest curve's peak; the held-out one too. An rms of 30 rows
    has a sampling error of 13 %.
    """
    _, _, report = closed
    before, after = report.baseline.error, report.final.error
    sd = report.noise.rows[0].sd
    assert before.fit.rmse > 5.0 * after.fit.rmse
    assert after.fit.rmse == pytest.approx(sd, rel=0.4) and after.holdout.rmse == pytest.approx(sd, rel=0.4)
    for row in after.curves.values():
        assert row.nrmse == pytest.approx(row.floor, rel=0.5)
    assert report.unit == "Pa" and report.n_eff <= 2 * ROWS


def test_what_is_written(closed):
    """Report, page, pictures and both model files, all listed; nothing beside the folder."""
    _, out, report = closed
    names = {path.name for path in out.iterdir()}
    assert names >= FILES and any(name.endswith(".png") for name in names)
    assert {Path(name).name for name in report.files} == names
    assert json.loads((out / "report.json").read_text(encoding="utf-8")) == json.loads(json.dumps(report.document))
    assert [path.name for path in out.parent.iterdir() if path.name.startswith(".")] == []
    assert "viscoelastic" in (out / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(("name", "side"), [("baseline.toml", "baseline"), ("model.toml", "final")])
def test_the_model_file_reproduces_the_errors(closed, name, side):
    """The simulator reads the file and is off by what the report says, to rounding."""
    data, out, report = closed
    rows = predict(data, out / name, processes=1).curves
    assert set(rows) == set(getattr(report, side).error.curves)
    for curve, row in rows.items():
        assert row.rmse == pytest.approx(getattr(report, side).error.curves[curve].rmse, rel=1e-6)
        assert row.nrmse == pytest.approx(getattr(report, side).error.curves[curve].nrmse, rel=1e-6)


def test_twice_the_same(closed, tmp_path, monkeypatch):
    """And the bar of a turn in the loop moves with the runs, and never goes back within a stage."""
    data, _, report = closed
    monkeypatch.chdir(tmp_path)
    seen: list[tuple[str, float]] = []
    again = close_loop(data, processes=1, progress=lambda stage, share: seen.append((stage, share)))
    first = {key: value for key, value in report.document.items() if key not in ("provenance", "files")}
    assert {key: value for key, value in again.document.items() if key != "provenance"} == first
    assert list(tmp_path.iterdir()) == []
    shares = [share for stage, share in seen if stage == "trace"]
    assert len(set(shares)) > 20 and shares == sorted(shares) and shares[-1] == 1.0


def test_a_control(tmp_path):
    report = close_loop(written(tmp_path / "data", g=0.0, seed=2), out=tmp_path / "out", processes=1)
    assert (report.verdict, report.effects, report.remainder) == ("no-missing-effect", [], "at-floor")
    assert "effects" not in (tmp_path / "out" / "model.toml").read_text(encoding="utf-8")
    low, high = report.final.parameters["C10_Pa"]["all"].ci95
    assert low < C10 * 1.03 and high > C10 * 0.97


def test_only_what_is_asked_for_is_considered(tmp_path):
    """Without its effect among the candidates nothing explains the data, and nothing is claimed."""
    data = written(tmp_path / "data")
    report = close_loop(data, effects=["third-yeoh"], processes=1)
    assert report.verdict == "unexplained" and report.effects == []
    assert set(report.causes) == {"third-yeoh"} and {one for row in report.hypotheses for one in row.effects} <= {"third-yeoh"}
    assert close_loop(data, max_effects=0, processes=1).verdict == "unexplained"


def test_one_curve_alone_is_not_confirmed(tmp_path):
    """One ramp does not tell relaxation from another law, and the report says what is lacking."""
    report = close_loop(written(tmp_path / "data", rates=(0.5,)), processes=1)
    assert report.verdict != "effect-found" and report.split.holdout == []
    assert any("one test only" in note for note in report.warnings)


def test_constants_of_two_groups(tmp_path):
    """Each group has its own constants in the report and in the model file."""
    data = written(tmp_path / "data", rates=(0.02, 0.5, 0.02, 0.5), lines=lambda k: f'constants = "{"AB"[k // 2]}"')
    report = close_loop(data, out=tmp_path / "out", processes=1)
    assert set(report.baseline.parameters["C10_Pa"]) == {"A", "B"}
    assert report.effects == ["viscoelastic"]
    rows = predict(data, tmp_path / "out" / "model.toml", processes=1).curves
    for curve, row in rows.items():
        assert row.rmse == pytest.approx(report.final.error.curves[curve].rmse, rel=1e-6)


def test_a_planned_test_has_the_constants_of_its_own_group(tmp_path):
    """One curve of group B, computed with what was found for both."""
    data = written(tmp_path / "data", rates=(0.02, 0.5, 0.02, 0.5), lines=lambda k: f'constants = "{"AB"[k // 2]}"')
    curves = tuple(read_dataset(data).curves)
    system = Specimens(read_dataset(data), curves, Simulator(1))
    both = system.start().at(system.start().x + [0.0, 0.0, 0.3, 0.0])
    C10 = both.values[2]
    assert both.values[0] != C10
    alone = replace(system, curves=curves[3:]).tissue(both)
    assert {name: c.C10_Pa for name, c in alone.constants.items()} == {"B": pytest.approx(C10)}


@pytest.mark.parametrize("conditions", ['repeat = "first"', 'cycle = "a"', "repeat = [1, 2]", "order = true"])
def test_conditions_are_free(tmp_path, conditions):
    """Known keys may hold words: then there is no order of repeats, and no error."""
    data = written(tmp_path / "data", g=0.0, lines=lambda k: f"conditions = {{ {conditions} }}")
    assert close_loop(data, max_effects=0, processes=1).verdict in ("no-missing-effect", "unexplained")


def test_curves_that_no_yeoh_solid_can_follow(tmp_path):
    """Stress against the stretch, everywhere: a failed fit is no missing effect, and the report is written all the same."""
    data = written(tmp_path / "data", g=0.0)
    for file in data.glob("*.csv"):
        head, *rows = file.read_text(encoding="utf-8").splitlines()
        cells = [row.rsplit(",", 1) for row in rows]
        file.write_text("\n".join([head, *(f"{a},{-float(b):.9g}" for a, b in cells)]), encoding="utf-8")
    report = close_loop(data, out=tmp_path / "out", processes=1)
    assert report.verdict == "failed" and "A failed fit does not show what the model lacks." in report.sentence
    assert {"report.json", "report.html"} <= {path.name for path in (tmp_path / "out").iterdir()}
    assert command(["close-loop", str(data), "--out", str(tmp_path / "other")]) == 3


@pytest.mark.xfail(
    strict=True,
    reason="relaxation that is slower than the test and softens with strain imitates a law that softens; the cause law needs a "
    "form that softens, such as a negative C20",
)
def test_a_curve_that_softens_is_no_third_term(tmp_path):
    """Stress in shear that levels off, as no Yeoh constant above 0 does: C20 ends at its bound, and a constant that can only
    stiffen is not found in its place.
    """
    folder = tmp_path / "data"
    folder.mkdir()
    rng = np.random.default_rng(3)
    text = 'format = "explicitfe-dataset/1"\nname = "soft"\ntitle = "x"\ntest = "shear"\n[specimen]\nshape = "point"\n'
    text += "[noise]\nstress_sd_Pa = 2.0\n"
    for k, last in enumerate((10.0, 2.0)):
        t = np.linspace(0.0, last, ROWS)
        x = 0.5 * t / last
        y = 200.0 * np.tanh(3.0 * x) + 2.0 * rng.standard_normal(ROWS)
        rows = "".join(f"{a:.9g},{b:.9g},{c:.9g}\n" for a, b, c in zip(t, x, y, strict=True))
        (folder / f"{k}.csv").write_text(f"time_s,shear_strain,shear_stress_Pa\n{rows}", encoding="utf-8")
        text += f'[[curve]]\nid = "{k}"\nfile = "{k}.csv"\n'
    (folder / "dataset.toml").write_text(text, encoding="utf-8")
    report = close_loop(folder, processes=1)
    assert (report.verdict, report.effects, report.remainder) == ("unexplained", [], "unexplained")
    assert any("C20_Pa reached a bound" in note for note in report.warnings)


# ---- the command line, and what cannot be used ----


def test_an_earlier_report_is_not_replaced_unless_asked(closed, tmp_path, capsys):
    """And the command prints one object: what it writes."""
    data, _, report = closed
    out = tmp_path / "out"
    assert command(["close-loop", str(data), "--out", str(out), "--max-effects", "0"]) == 0
    before = (out / "report.json").read_bytes()
    assert command(["close-loop", str(data), "--out", str(out)]) == 2
    assert "--overwrite" in capsys.readouterr().err and (out / "report.json").read_bytes() == before
    assert command(["close-loop", str(data), "--out", str(out), "--overwrite", "--json"]) == 0
    printed = check_answer("close-loop", capsys.readouterr().out)
    assert (printed["verdict"], printed["effects"]) == ("effect-found", report.effects)
    assert printed["final"] == json.loads(json.dumps(report.document))["final"]
    stored = json.loads((out / "report.json").read_text(encoding="utf-8"))
    assert (stored["verdict"], stored["final"]) == (printed["verdict"], printed["final"])
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_folder_of_something_else_is_left_alone(closed, tmp_path):
    data, _, _ = closed
    (tmp_path / "diary.txt").write_text("mine", encoding="utf-8")
    assert command(["close-loop", str(data), "--out", str(tmp_path), "--overwrite"]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["diary.txt"]


def test_a_report_that_fails_halfway_leaves_nothing(closed, tmp_path, monkeypatch):
    """The page cannot be drawn: the folder does not exist afterwards, nor does what was written beside it."""
    from explicitfe.app.view.page.close_loop import page as loopreport

    def fails(*_args, **_more):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(loopreport, "write", fails)
    assert command(["close-loop", str(closed[0]), "--out", str(tmp_path / "out"), "--max-effects", "0"]) == 3
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--effects", "viscosity"], ["viscosity", "viscoelastic"]),
        (["--max-effects", "-1"], ["--max-effects -1"]),
        (["--holdout", "ramp-9"], ["ramp-9", "did you mean"]),
        (["--holdout", "ramp-0", "--holdout", "ramp-1", "--holdout", "ramp-2"], ["held out"]),
        (["--constants-by", "muscle"], ["muscle"]),
    ],
)
def test_options_that_cannot_be(closed, options, words, tmp_path, capsys):
    assert command(["close-loop", str(closed[0]), "--out", str(tmp_path / "out"), *options]) == 2
    said = capsys.readouterr()
    assert said.out == "" and all(word in said.err for word in words), said.err
    assert list(tmp_path.iterdir()) == []


def put(file: str, pattern: str, new: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        text = (folder / file).read_text(encoding="utf-8")
        changed, count = re.subn(pattern, new, text, count=1, flags=re.MULTILINE)
        assert count == 1, pattern
        (folder / file).write_text(changed, encoding="utf-8")

    return change


def with_stress_times(by: float) -> Callable[[Path], None]:
    """Stress in another unit."""

    def change(folder: Path) -> None:
        file = folder / "ramp-0.csv"
        head, *rows = file.read_text(encoding="utf-8").splitlines()
        cells = [row.rsplit(",", 1) for row in rows]
        file.write_text("\n".join([head, *(f"{a},{by * float(b):.9g}" for a, b in cells)]) + "\n", encoding="utf-8")

    return change


T, ZERO = "dataset.toml", "ramp-0.csv"
BAD = {
    "unknown key": (put(T, "^title", 'licence = "x"\ntitle'), [T, "line 3", "licence"]),
    "unknown key of the specimen": (put(T, 'shape = "point"', 'shape = "point"\nradius = 3.0'), [T, "line 7", "radius"]),
    "missing column": (put(ZERO, ",nominal_stress_Pa", ""), [ZERO, "line 1", "nominal_stress_Pa"]),
    "time that runs backwards": (put(ZERO, r"\Z", "0.1,0.9,-10\n"), [ZERO, "line 32", "backwards"]),
    "time from 1": (put(ZERO, "^0,", "0.01,"), [ZERO, "line 2", "time_s"]),
    "NaN": (put(ZERO, r"[^,]*\n\Z", "nan\n"), [ZERO, "line 31", "nan"]),
    "too few rows": (
        lambda folder: (folder / ZERO).write_text("time_s,stretch,nominal_stress_Pa\n0,1,0\n1,0.9,-90\n", encoding="utf-8"),
        [ZERO, "line 3", "at least 3"],
    ),
    "a file that is not listed": (
        lambda folder: (folder / "more.csv").write_text("", encoding="utf-8"),
        ["more.csv", "no curve of"],
    ),
    "a file that is missing": (lambda folder: (folder / ZERO).unlink(), [T, ZERO, "missing"]),
    "stress in kPa and below": (with_stress_times(1e-6), [ZERO, "line ", "nominal_stress_Pa", "too small"]),
    "stress in uPa": (with_stress_times(1e9), [ZERO, "line ", "nominal_stress_Pa", "too large"]),
    "stretch in percent": (put(ZERO, "^0,1,", "0,100,"), [ZERO, "line 2", "percent"]),
    "held out without a fit curve": (
        put(T, 'id = "ramp-1"', 'id = "ramp-1"\nsplit = "holdout"\nconstants = "B"'),
        ["ramp-1", '"B"'],
    ),
    "no dataset": (lambda folder: (folder / T).unlink(), [T, "cannot be read"]),
}


@pytest.mark.parametrize(("change", "words"), BAD.values(), ids=list(BAD))
def test_bad_datasets(change, words, tmp_path, capsys):
    """Exit code 2, one sentence that names the file and the line, and nothing written."""
    data = written(tmp_path / "data", g=0.0)
    change(data)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert command(["close-loop", str(data), "--out", str(tmp_path / "out"), "--json"]) == 2
    said = capsys.readouterr()
    assert said.err.count("error:") == 1
    reading, sentence = said.err.strip().splitlines()
    assert reading.startswith("reading ")
    error = json.loads(said.out)["failure"]
    assert error == {"kind": "input", "message": sentence.removeprefix("error: "), "exit_code": 2}
    assert sentence.endswith((".", "?")) and "Traceback" not in sentence
    assert all(word in sentence for word in words), sentence
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
