"""Comparison of laws and model-form error: the table of a tensile machine, Yeoh data, unstable data, tests under a tool."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from answers import check_answer
from command import command
from identify_cases import COARSE, LOADS_N, response, write, write_homogeneous

from explicitfe.app.api.inverse import identify
from explicitfe.fem.materials.homogeneous import nominal_stress
from explicitfe.fem.materials.ogden import Ogden
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.inverse.identify.laws import FIT_LAWS
from explicitfe.platform.errors import InputError
from explicitfe.results.documents.identification import Identification

pytestmark = pytest.mark.slow

MU_PA, ALPHA = 25e3, 4.0
SPECIMEN = ["--tool", "clamps", "--length-mm", "30", "--area-mm2", "40", "--one-specimen"]
YEOH_3 = Yeoh(C10_Pa=574.0, C20_Pa=-74.7, C30_Pa=11.3)


def tensile_table(path: Path, seed: int = 1, rows: int = 200) -> None:
    """What a tensile machine writes of an Ogden strip: 0.5 % noise of the largest force, unloading 18 % below loading."""
    stretch = np.concatenate([np.linspace(1.0, 1.6, rows), np.linspace(1.6, 1.0, rows)[1:]])
    # Incompressible: P = 2 mu / alpha (l^(alpha - 1) - l^(-alpha / 2 - 1)).
    stress = 2.0 * MU_PA / ALPHA * (stretch ** (ALPHA - 1.0) - stretch ** (-ALPHA / 2.0 - 1.0))
    stress[rows:] *= 1.0 - 0.18
    force = 40e-6 * stress
    force += 0.005 * force.max() * np.random.default_rng(seed).standard_normal(len(force))
    lines = [f"{0.1 * k:.2f},{30.0 * (s - 1.0):.4f},{f:.5f}" for k, (s, f) in enumerate(zip(stretch, force, strict=True))]
    path.write_text("time (s),extension (mm),force (N)\n" + "\n".join(lines) + "\n", encoding="utf-8")


@pytest.fixture(scope="module")
def pulled(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("pulled")
    tensile_table(folder / "pull.csv")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert command(["new", "dataset", "pull.csv", "--test", "tension", *SPECIMEN]) == 0
    return folder / "pull"


@pytest.fixture(scope="module")
def by_yeoh(pulled) -> Identification:
    return identify(pulled)


def holds(interval, value: float) -> bool:
    return bool(interval[0] <= value <= interval[1])


def test_the_interval_of_a_wrong_law_holds_the_small_strain_modulus(by_yeoh):
    """Yeoh's law does not describe an Ogden material: without the model-form error the interval excludes the truth."""
    group = by_yeoh["groups"]["all"]
    C10 = group["constants"]["C10_Pa"]
    assert not holds(C10["ci95_of_noise"], MU_PA / 2.0)
    assert holds(C10["ci95"], MU_PA / 2.0)
    assert holds(group["shear_modulus"]["ci95"], MU_PA)
    assert holds(group["youngs_modulus"]["ci95"], 3.0 * MU_PA)
    # An interval of 0 to infinity would hold it as well.
    assert np.ptp(C10["ci95"]) < 0.2 * C10["value"]
    assert group["law"] == by_yeoh["law"] == "yeoh"


def test_the_misfit_is_reported_and_the_right_law_preferred(by_yeoh):
    group = by_yeoh["groups"]["all"]
    laws = {row["law"]: row for row in group["laws"]}
    assert set(laws) == set(FIT_LAWS)
    assert min(laws, key=lambda name: laws[name]["aicc_difference"]) == "ogden-1"
    assert min(laws, key=lambda name: laws[name]["bic_difference"]) == "ogden-1"
    assert laws["yeoh"]["aicc_difference"] > 20.0
    assert laws["ogden-1"]["held_out_nrmse"] < 0.5 * laws["yeoh"]["held_out_nrmse"]
    assert group["misfit"]["depends_on_range"] and group["misfit"]["model_form"] > 5.0
    # The residual of the right law is the noise, 0.5 % of the largest force.
    assert laws["ogden-1"]["nrmse"] == pytest.approx(0.005, rel=0.15)
    text = " ".join(group["warnings"])
    assert "The data support the law ogden-1 more than yeoh" in text
    assert "does not describe the whole range" in text
    assert "An elastic law cannot describe hysteresis; only the loading branch was fitted. 199 rows" in text


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_the_interval_holds_with_other_noise(tmp_path, monkeypatch, seed):
    """Chance alone excludes the truth in 5 of 100 such tables."""
    tensile_table(tmp_path / "pull.csv", seed, rows=60)
    monkeypatch.chdir(tmp_path)
    assert command(["new", "dataset", "pull.csv", "--test", "tension", *SPECIMEN]) == 0
    assert holds(identify("pull")["groups"]["all"]["shear_modulus"]["ci95"], MU_PA)


def test_all_laws_report_the_preferred_one(pulled, capsys):
    assert command(["identify", str(pulled), "--law", "all", "--json"]) == 0
    group = check_answer("identify", capsys.readouterr().out)["groups"]["all"]
    assert group["law"] == "ogden-1"
    assert holds(group["constants"]["mu1_Pa"]["ci95"], MU_PA) and holds(group["constants"]["alpha1"]["ci95"], ALPHA)
    assert np.ptp(group["constants"]["mu1_Pa"]["ci95"]) < 0.03 * MU_PA
    assert not group["misfit"]["depends_on_range"] and group["misfit"]["model_form"] < 1.5


def test_the_terminal_and_the_files_name_the_law(pulled, capsys, tmp_path):
    assert command(["identify", str(pulled), "--law", "all", "--out", str(tmp_path / "fit")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "ogden-1; compared with" in printed and "comparison of laws" in printed and "held-out" in printed
    assert tomllib.loads((tmp_path / "fit" / "material.toml").read_text())["all"]["law"] == "ogden"
    page = (tmp_path / "fit" / "identify.html").read_text()
    assert "Comparison of laws" in page and "Material law: ogden-1" in page


def made(folder: Path, law: Yeoh | Ogden, stretch: np.ndarray, noise: float = 1.0) -> Path:
    stress = nominal_stress(law, "uniaxial", stretch) + noise * np.random.default_rng(5).standard_normal(len(stretch))
    text = f"stress_sd_Pa = {noise}"
    return write_homogeneous(folder, "tension", "stretch,nominal_stress_Pa", stretch, stress, text)


def test_data_of_the_law_itself_are_not_held_against_it(tmp_path):
    stretch = np.linspace(1.0, 1.6, 60)
    group = identify(made(tmp_path / "data", Yeoh(C10_Pa=500.0, C20_Pa=200.0), stretch))["groups"]["all"]
    rows = {row["law"]: row for row in group["laws"]}
    assert rows["yeoh"]["aicc_difference"] < 2.0 and rows["neo-hooke"]["aicc_difference"] > 100.0
    assert not group["misfit"]["depends_on_range"]
    # Ogden's law with two terms describes these data as well, with another modulus by 1 %: the interval includes that.
    assert np.ptp(group["shear_modulus"]["ci95"]) < 0.03 * 1000.0
    assert holds(group["constants"]["C10_Pa"]["ci95"], 500.0) and holds(group["constants"]["C20_Pa"]["ci95"], 200.0)
    assert group["misfit"]["reduced_chi2"] == pytest.approx(1.0, abs=0.6)


def test_three_yeoh_terms_with_a_negative_one_come_back(tmp_path):
    """The constants of FEBio's test ma61."""
    identification = identify(made(tmp_path / "data", YEOH_3, np.linspace(0.5, 2.5, 120)), law="yeoh-3", poisson=YEOH_3.poisson)
    group = identification["groups"]["all"]
    assert [row["law"] for row in group["laws"]] == ["yeoh-3"]  # A law by its name is fitted alone.
    for name in ("C10_Pa", "C20_Pa", "C30_Pa"):
        assert holds(group["constants"][name]["ci95"], getattr(YEOH_3, name)), name
    assert group["constants"]["C20_Pa"]["value"] < 0.0
    assert not any("stability" in warning for warning in group["warnings"])


def test_a_fit_that_is_unstable_within_the_data_is_not_used(tmp_path):
    """Stress that falls beyond a stretch of 1.35: Yeoh constants of any sign would follow it, and no stable law can."""
    stretch = np.linspace(1.0, 1.7, 60)
    stress = 1000.0 * np.sin(np.pi / 0.7 * (stretch - 1.0))
    data = write_homogeneous(tmp_path / "data", "tension", "stretch,nominal_stress_Pa", stretch, stress, "stress_sd_Pa = 1.0")
    group = identify(data)["groups"]["all"]
    assert group["at_bound"] == ["C20_Pa"] and group["constants"]["C20_Pa"]["value"] == 0.0
    assert all(row["unstable_at_stretch"] is None for row in group["laws"])


def test_constants_that_simulations_refuse_are_announced(tmp_path):
    """Stable within the data, a compression by 20 %, and unstable below a stretch of 0.5."""
    law = Yeoh.model_construct(law="yeoh", C10_Pa=500.0, C20_Pa=-100.0, C30_Pa=0.0, poisson=0.499)
    group = identify(made(tmp_path / "data", law, np.linspace(1.0, 0.8, 60), noise=0.5))["groups"]["all"]
    assert group["constants"]["C20_Pa"]["value"] < 0.0
    assert any("outside the data; simulations refuse them" in warning for warning in group["warnings"])


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"law": "ogden"}, "`law` ogden: there is no such law; valid are yeoh, neo-hooke, mooney-rivlin, yeoh-3, ogden-1"),
        ({"law": "ogden-1"}, "`law` ogden-1: this law is fitted to homogeneous tests only"),
        ({"law": "neo-hooke", "method": "paper"}, "the paper's method identifies Yeoh constants only"),
    ],
)
def test_laws_that_cannot_be_fitted(tmp_path, options, sentence):
    depths = response().at_force(LOADS_N, 190.0, 87.0)[0]
    with pytest.raises(InputError, match=sentence):
        identify(write(tmp_path / "data", {"one": (depths, LOADS_N)}), **options, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_laws_under_a_tool_are_compared_on_request(tmp_path):
    """Data of Yeoh's law: the other laws are fitted by runs of their own, and Yeoh is preferred."""
    loads = np.array([0.1, 0.2, 0.3, 0.45, 0.6, 0.7])
    depths = response().at_force(loads, 190.0, 87.0)[0]
    identification = identify(write(tmp_path / "data", {"one": (depths, loads)}), law="all", refinement=COARSE)
    group = identification["groups"]["all"]
    assert [row["law"] for row in group["laws"]] == ["yeoh", "neo-hooke", "mooney-rivlin"]
    assert group["law"] == "yeoh"
    rows = {row["law"]: row for row in group["laws"]}
    assert rows["neo-hooke"]["aicc_difference"] > 10.0
    assert holds(group["constants"]["C10_Pa"]["ci95"], 190.0)
