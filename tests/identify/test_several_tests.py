"""Closed forms of homogeneous tests, alone and together: Treloar's rubber, and data with known constants and noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command import command
from identify_cases import COARSE, TRUTH, response, write_homogeneous

from explicitfe.app.api.inverse import close_loop, identify
from explicitfe.fem.materials.homogeneous import nominal_stress
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.inverse.close_loop.outlook import check_dataset
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.platform.errors import InputError

# Stretch and nominal stress [MPa] of 8 % sulphur rubber at 20 °C in simple elongation: Treloar (1944), Trans. Faraday Soc. 40,
# 59-70, as tabulated by Steinmann, Hossain and Possart (2012), Arch. Appl. Mech. 82, 1183-1217.
UNIAXIAL = """1 0, 1.01 .03, 1.12 .14, 1.24 .23, 1.39 .32, 1.61 .41, 1.89 .5, 2.17 .58, 2.42 .67, 3.01 .85, 3.58 1.04, 4.03 1.21,
4.76 1.58, 5.36 1.94, 5.76 2.29, 6.16 2.67, 6.4 3.02, 6.62 3.39, 6.87 3.75, 7.05 4.12, 7.16 4.47, 7.27 4.85, 7.43 5.21, 7.5 5.57,
7.61 6.3"""


def treloar() -> tuple[np.ndarray, np.ndarray]:
    """Stretch, and nominal stress [Pa]."""
    stretch, stress = np.array([row.split() for row in UNIAXIAL.split(",")], dtype=float).T
    return stretch, 1e6 * stress


@pytest.fixture
def rubber(tmp_path) -> Path:
    return write_homogeneous(tmp_path / "rubber", "tension", "stretch,nominal_stress_Pa", *treloar())


def test_a_fit_of_rubber_is_that_of_the_incompressible_closed_form(rubber):
    """The three Yeoh constants follow by linear least squares from P = 2 (l - l^-2) sum i C_i0 (I1 - 3)^(i - 1)."""
    stretch, stress = treloar()
    I1 = stretch**2 + 2.0 / stretch
    basis = np.stack([2.0 * (stretch - stretch**-2) * i * (I1 - 3.0) ** (i - 1) for i in (1, 2, 3)], axis=1)
    exact = np.linalg.lstsq(basis, stress, rcond=None)[0]
    assert exact == pytest.approx([175.5e3, -1879.0, 46.3], rel=1e-3)
    answer = identify(rubber, law="yeoh-3")
    group = answer["groups"]["all"]
    assert [row["value"] for row in group["constants"].values()] == pytest.approx(exact, rel=1e-6)
    assert "an estimate" in group["headline"] and group["headline"].endswith("Known to no better than 30 %: C20.")
    (ratio,) = group["hides"]  # It is computed, and no part of the interval: the answer is of the incompressible law.
    assert ratio["if"] == "Poisson's ratio 0.499" and ratio["C20_change"] == pytest.approx(-0.388, abs=0.01)
    assert not ratio["left_open"] and group["constants"]["C20_Pa"]["total95"] == group["constants"]["C20_Pa"]["ci95"]
    assert answer["poisson"] == 0.5 and "Poisson's ratio 0.5 (incompressible closed form)" in group["assumed"]
    assert group["youngs_modulus"]["value"] == pytest.approx(3.0 * group["shear_modulus"]["value"])


def test_a_stated_ratio_is_used_by_the_closed_form(rubber):
    answer = identify(rubber, law="yeoh-3", poisson=0.499)
    assert answer["groups"]["all"]["constants"]["C10_Pa"]["value"] == pytest.approx(186.5e3, rel=1e-3)
    assert answer["poisson"] == 0.499 and answer["groups"]["all"]["assumed"] == ["Poisson's ratio 0.499"]


# ---- several tests ----

# Equibiaxial tension and pure shear of the same rubber, from the same table.
EQUIBIAXIAL = """1 0, 1.04 .09, 1.08 .16, 1.12 .24, 1.14 .26, 1.2 .33, 1.31 .44, 1.42 .51, 1.69 .65, 1.94 .77, 2.49 .96,
3.03 1.24, 3.43 1.45, 3.75 1.72, 4.03 1.96, 4.26 2.22, 4.44 2.43"""
PLANAR = """1 0, 1.06 .07, 1.14 .16, 1.21 .24, 1.32 .33, 1.46 .42, 1.87 .59, 2.4 .76, 2.98 .93, 3.48 1.11, 3.96 1.28, 4.36 1.46,
4.69 1.62, 4.96 1.79"""


def write_tests(folder: Path, head: str, curves: dict[str, tuple[str, np.ndarray, np.ndarray, str]]) -> Path:
    """A dataset of several tests: id -> column names, imposed and measured column, and further lines of the curve."""
    folder.mkdir()
    text = f'format = "explicitfe-dataset/1"\nname = "several"\ntitle = "Several tests"\n{head}\n'
    for name, (columns, x, y, lines) in curves.items():
        text += f'[[curve]]\nid = "{name}"\nfile = "{name}.csv"\n{lines}\n'
        rows = "".join(f"{k},{a:.9g},{b:.9g}\n" for k, (a, b) in enumerate(zip(x, y, strict=True)))
        (folder / f"{name}.csv").write_text(f"time_s,{columns}\n{rows}", encoding="utf-8")
    (folder / "dataset.toml").write_text(text, encoding="utf-8")
    return folder


STRETCHED = "stretch,nominal_stress_Pa"
POINT = 'test = "tension"\n[specimen]\nshape = "point"'


@pytest.fixture
def tables(tmp_path, monkeypatch) -> list[str]:
    """Files of a machine with Treloar's three tests."""
    monkeypatch.chdir(tmp_path)
    names = []
    for name, rows in (("uniaxial", UNIAXIAL), ("equibiaxial", EQUIBIAXIAL), ("planar", PLANAR)):
        lines = [",".join(row.split()) for row in rows.split(",")]
        Path(f"{name}.csv").write_text("Stretch (-),Nominal stress (MPa)\n" + "\n".join(lines) + "\n", encoding="utf-8")
        names.append(f"{name}.csv")
    return names


def test_one_fit_of_three_tests_is_that_of_the_closed_forms(tables, capsys):
    """Mooney and Rivlin's law is linear in its constants; every test is weighted by its largest stress."""
    stated = ["--test", "tension,equibiaxial,planar", "--rate", "0.01", "--one-specimen", "--out", "rubber"]
    assert command(["new", "dataset", *tables, *stated]) == 0
    assert "explicitfe close-loop" not in capsys.readouterr().err
    assert [curve.kind for curve in read_dataset("rubber").curves] == ["uniaxial", "equibiaxial", "planar"]
    basis, measured = [], []
    for rows, second in ((UNIAXIAL, -0.5), (EQUIBIAXIAL, 1.0), (PLANAR, 0.0)):
        stretch, stress = np.array([row.split() for row in rows.split(",")], dtype=float).T
        held = stretch**second
        free = 1.0 / (stretch * held)
        # P = 2 (l - free^2 / l) (C10 + C01 held^2) along one direction of the load.
        first = 2.0 * (stretch - free**2 / stretch)
        basis.append(np.stack([first, first * held**2], axis=1) / stress.max())
        measured.append(stress / stress.max())
    exact = 1e6 * np.linalg.lstsq(np.concatenate(basis), np.concatenate(measured), rcond=None)[0]
    group = identify("rubber", law="mooney-rivlin")["groups"]["all"]
    assert min(exact) > 0.0 and len(group["curves"]) == 3
    assert [row["value"] for row in group["constants"].values()] == pytest.approx(exact, rel=1e-6)
    best = identify("rubber", law="all")["groups"]["all"]
    assert best["law"] == "ogden-3" and all(row["nrmse"] < 0.03 for row in best["curves"].values())


def test_every_test_counts_by_its_noise(tmp_path):
    """Five kinds of tests of one tissue: the constants come back, and more exactly than from the best kind alone."""
    rng, curves = np.random.default_rng(3), {}
    law = Yeoh.model_construct(C10_Pa=TRUTH[0], C20_Pa=TRUTH[1], C30_Pa=0.0, poisson=0.5)
    sds = {"tension": 2.0, "equibiaxial": 40.0, "planar": 8.0, "shear": 4.0}
    for test, mode in (("tension", "uniaxial"), ("equibiaxial", "biaxial"), ("planar", "planar"), ("shear", "shear")):
        x = np.linspace(0.0, 0.6, 25) if test == "shear" else np.linspace(1.0, 1.5, 25)
        y = nominal_stress(law, mode, x) + sds[test] * rng.standard_normal(len(x))
        columns = "shear_strain,shear_stress_Pa" if test == "shear" else STRETCHED
        curves[test] = columns, x, y, f'test = "{test}"\nnoise = {{ stress_sd_Pa = {sds[test]} }}'
    loads = np.linspace(0.1, 0.7, 7)
    depths = 1e3 * response().at_force(loads, *TRUTH)[0] + 0.01 * rng.standard_normal(len(loads))
    tool = 'shape = "flat-cylinder", radius_mm = 14.0, edge_radius_mm = 2.0, control = "force", friction = 0.0'
    specimen = 'shape = "cylinder", radius_mm = 35.0, height_mm = 20.0, base = "bonded"'
    of_tool = f'test = "indentation"\ntool = {{ {tool} }}\nspecimen = {{ {specimen} }}\nnoise = {{ displacement_sd_mm = 0.01 }}'
    curves["indentation"] = "displacement_mm,force_N", depths, loads, of_tool
    answer = identify(write_tests(tmp_path / "all", POINT, curves), refinement=COARSE, out=tmp_path / "fit")
    group = answer["groups"]["all"]
    alone = identify(write_tests(tmp_path / "one", POINT, {"tension": curves["tension"]}), law="yeoh")["groups"]["all"]
    for name, right in zip(("C10_Pa", "C20_Pa"), TRUTH, strict=True):
        low, high = group["constants"][name]["ci95"]
        assert low < right < high and high - low < 0.7 * np.ptp(alone["constants"][name]["ci95"])
    # The standard deviation of chi2 is the square root of twice the degrees of freedom.
    assert group["chi2"] == pytest.approx(group["degrees_of_freedom"], rel=0.35)
    assert {"Poisson's ratio 0.499", "Poisson's ratio 0.5 (incompressible closed form)"} <= set(group["assumed"])
    assert {row["unit"] for row in group["curves"].values()} == {"Pa", "mm"} and group["noise_sd"] < 50.0
    assert group["hides"] and len(list((tmp_path / "fit").glob("fit*.png"))) == 3  # one for each pair of axes


@pytest.mark.parametrize(
    ("lines", "sentence"),
    [
        ('test = "biaxial"', "equibiaxial"),
        ('test = "planar"\ntool = { shape = "platen", control = "force" }', "has no .tool."),
        ('test = "indentation"', "needs a .tool."),
        ('test = "compression"\ntool = { shape = "platen", control = "force" }', "needs its own specimen"),
        ('test = "shear"', 'unknown column "stretch"'),
    ],
)
def test_a_test_that_does_not_fit_its_curve_is_refused(tmp_path, lines, sentence):
    x = np.linspace(1.0, 1.5, 9)
    curves = {"one": (STRETCHED, x, 1e3 * (x - 1.0), ""), "two": (STRETCHED, x, 1e3 * (x - 1.0), lines)}
    with pytest.raises(InputError, match=sentence):
        read_dataset(write_tests(tmp_path / "data", POINT, curves))


def test_commands_for_one_kind_of_test_say_so(tmp_path):
    x = np.linspace(1.0, 1.5, 9)
    curves = {"one": (STRETCHED, x, 1e3 * (x - 1.0), ""), "two": (STRETCHED, x, 1e3 * (x - 1.0), 'test = "planar"')}
    data = write_tests(tmp_path / "data", POINT, curves)
    with pytest.raises(InputError, match=r"tests of one kind, .* and these are uniaxial, planar; use identify"):
        close_loop(data)
    assert check_dataset(data)["can_show"] == []
