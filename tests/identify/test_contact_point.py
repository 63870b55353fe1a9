"""The contact point: rows of the approach, the zero of the displacement, and its interval in a fit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command import command
from identify_cases import DEEPEST_M, TRUTH, response

from explicitfe.inverse.close_loop.specimens.features import features_of
from explicitfe.inverse.close_loop.specimens.series import series_of
from explicitfe.inverse.identify.fit import contact_interval, least_squares_fit
from explicitfe.inverse.identify.forward import CurveModel
from explicitfe.inverse.identify.laws import FIT_LAWS
from explicitfe.inverse.identify.observed import Observed
from explicitfe.inverse.measured.contact import SMALL_FORCE_SHARE, approach_of, contact_before
from explicitfe.inverse.measured.read import read_dataset

DEPTHS_MM = np.arange(-1.0, 1.001, 0.02)
SD_N = 0.001
SIZES = ["--diameter-mm", "60", "--height-mm", "30", "--base", "frictionless", "--friction", "0", "--one-specimen"]


def curve(power: float, contact_mm: float = 0.0, offset_N: float = 0.0, seed: int = 1, sd_N: float = SD_N) -> np.ndarray:
    """Forces [N] of a tool with a power, at ``DEPTHS_MM``."""
    noise = sd_N * np.random.default_rng(seed).standard_normal(len(DEPTHS_MM))
    return offset_N + 0.05 * np.maximum(DEPTHS_MM - contact_mm, 0.0) ** power + noise


def contact_sd_mm(power: float, contact_mm: float = 0.2) -> float:
    """Cramer-Rao bound of the contact [mm], whose estimate uses the rows up to 30 % of the largest force.

    The force is a + b (x - contact)^power with unknown a, b and contact, and independent noise of SD_N in each row.
    """
    depth = np.maximum(DEPTHS_MM - contact_mm, 0.0)
    used = depth**power <= SMALL_FORCE_SHARE * (depth**power).max()
    slope = np.where(depth > 0.0, -0.05 * power * depth ** (power - 1.0), 0.0)
    jacobian = np.stack([np.ones(len(depth)), depth**power, slope], axis=1)[used]
    return float(SD_N * np.sqrt(np.linalg.inv(jacobian.T @ jacobian)[2, 2]))


@pytest.mark.parametrize("power", [1.0, 1.5])
@pytest.mark.parametrize("offset_N", [0.0, 0.3, -0.02])
def test_an_approach_is_recognised(power: float, offset_N: float) -> None:
    """The error of the contact is that of the best unbiased estimate, 0.011 mm for a flat tool and 0.024 mm for a ball.

    The rms of 200 errors has a spread of 5 %, and the kink of a flat tool between two rows costs 15 %: 30 % in all.
    """
    exact = approach_of(DEPTHS_MM, curve(power, 0.2, offset_N, sd_N=0.0), power)
    assert exact is not None and exact.contact == pytest.approx(0.2, abs=1e-4)
    errors, forces = [], []
    for seed in range(200):
        approach = approach_of(DEPTHS_MM, curve(power, 0.2, offset_N, seed), power)
        if approach is not None:
            errors.append(approach.contact - 0.2)
            forces.append(approach.force - offset_N)
            assert approach.rows == int((approach.contact > DEPTHS_MM).sum())
    assert len(errors) >= 196  # The slope of an approach exceeds three of its errors in 0.3 % of the cases.
    assert np.sqrt(np.mean(np.square(errors))) < 1.3 * contact_sd_mm(power)
    assert abs(np.mean(errors)) < 0.5 * contact_sd_mm(power)
    assert np.std(forces) < 1.3 * SD_N / np.sqrt(60)  # the mean of 60 rows


@pytest.mark.parametrize(
    "force",
    [
        curve(1.0, -1.0), curve(1.5, -1.0), curve(1.5, -1.0, 0.1), curve(1.0, -1.3), 0.2 * (DEPTHS_MM + 1.0) ** 3,
        0.02 * (DEPTHS_MM + 1.0) + 0.13 * (DEPTHS_MM + 1.0) ** 2 + curve(1.0, 9.0), curve(1.0, 9.0), np.zeros(len(DEPTHS_MM)),
        0.1 * np.expm1(2.0 * (DEPTHS_MM + 1.0)) + curve(1.0, 9.0), np.full(len(DEPTHS_MM), 0.3),
    ],
)  # fmt: skip
def test_a_tool_that_touches_from_the_first_row_has_no_approach(force: np.ndarray) -> None:
    """Also where the force begins at zero and stiffens, and where there is no force at all."""
    assert approach_of(DEPTHS_MM, force, 1.0) is None
    assert approach_of(DEPTHS_MM, force, 1.5) is None


def test_the_zero_is_extrapolated_by_the_power_of_the_tool() -> None:
    for power in (1.0, 1.5):
        touching = DEPTHS_MM > 0.4
        assert contact_before(DEPTHS_MM[touching], curve(power, 0.2, sd_N=0.0)[touching], power) == pytest.approx(0.2, abs=1e-3)


def made(folder: Path, tool: list[str], power: float, *options: str, offset_N: float = 0.0) -> tuple[Path, list[str]]:
    """A dataset of a table that begins 1.2 mm above the specimen, and the notes."""
    force = curve(power, 0.2, offset_N)
    rows = "".join(f"{0.1 * k:.1f},{x + 11.0:.4f},{f:.5f}\n" for k, (x, f) in enumerate(zip(DEPTHS_MM, force, strict=True)))
    (folder / "a.csv").write_text(f"Time (s),Position (mm),Force (N)\n{rows}", encoding="utf-8")
    noise = ["--force-sd-N", str(SD_N)]
    assert (
        command(["new", "dataset", str(folder / "a.csv"), *tool, *SIZES, *noise, *options, "--out", str(folder / "b"), "--json"])
        == 0
    )
    return folder / "b", tool


BALL = ["--test", "indentation", "--tool", "sphere", "--tool-diameter-mm", "10"]
PLATEN = ["--test", "compression"]


@pytest.mark.parametrize(("tool", "power"), [(BALL, 1.5), (PLATEN, 1.0)], ids=["ball", "platen"])
@pytest.mark.parametrize("options", [[], ["--contact-force-N", "0.004"]], ids=["all rows", "contact force"])
def test_a_dataset_is_zero_at_contact(
    tool: list[str], power: float, options: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = made(tmp_path, tool, power, *options, offset_N=0.05)
    notes = " ".join(json.loads(capsys.readouterr().out)["notes"])
    assert "the tool does not touch in the first" in notes and "mean force of these rows, 0.0" in notes
    (made_curve,) = read_dataset(folder).specimens("").curves
    assert made_curve.fit_contact
    if not options:
        assert len(made_curve.time_s) == len(DEPTHS_MM)
        np.testing.assert_allclose(1e3 * made_curve.displacement_m + 0.2, DEPTHS_MM, atol=3.0 * contact_sd_mm(power))
        assert abs(made_curve.force_N[:40].mean()) < 1e-3
        features = features_of([made_curve], [series_of(made_curve, "a", "")])
        assert "unloading" not in features and "force that pulls" not in features
    else:
        assert 0.0 < 1e3 * made_curve.displacement_m[0] < 0.4
    assert command(["check", str(folder), "--json"]) == 0
    warnings = " ".join(json.loads(capsys.readouterr().out)["warnings"])
    assert ("the tool does not touch in the first" in warnings) == (not options)
    assert "check that it was zeroed" not in warnings


@pytest.mark.parametrize("contact", ['contact = "fit"', ""], ids=["fitted", "given"])
def test_identify_fits_the_contact_and_counts_the_rows_before_it(
    contact: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A platen on a sliding base: F = A E e at small compressions, so E = 530 Pa with A = 2827 mm2 and 30 mm."""
    folder, _ = made(tmp_path, PLATEN, 1.0)
    text = (folder / "dataset.toml").read_text("utf-8")
    line = next(line for line in text.splitlines() if line.startswith("contact"))
    (folder / "dataset.toml").write_text(text.replace(line, contact), encoding="utf-8")
    csv = (folder / "a.csv").read_text("utf-8").splitlines()
    cells = [row.split(",") for row in csv[1:]]
    zero = float(cells[0][1])  # as a person writes it, who does not know the contact
    lines = [csv[0], *(f"{a},{float(b) - zero:.6f},{c}" for a, b, c in cells)]
    (folder / "a.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    capsys.readouterr()
    law = "all" if contact else "neo-hooke"
    assert command(["identify", str(folder), "--law", law, "--out", str(tmp_path / "c"), "--json"]) == 0
    (group,) = json.loads(capsys.readouterr().out)["groups"].values()
    modulus, warnings = group["youngs_modulus"], " ".join(group["warnings"])
    right = 0.05 * 30.0 / (np.pi * 30.0**2) * 1e6
    if contact:
        assert modulus["ci95"][0] < right < modulus["ci95"][1] and modulus["ci95"][1] < 1.5 * modulus["ci95"][0]
        low, high = group["curves"]["a"]["contact_ci95_mm"]
        assert low < 1.2 < high and high - low < 0.2
        assert group["curves"]["a"]["rows_before_contact"] in (60, 61)
        assert f"{group['curves']['a']['rows_before_contact']} rows are not in contact" in warnings
    else:
        assert modulus["ci95"][1] < 0.8 * right
        assert modulus["total95"][1] > 0.99 * right  # The data are linear, and the law is not.
        assert "a fitted contact instead of contact at 0" in {row["if"] for row in group["hides"] if row["left_open"]}
        assert "a fitted contact instead of contact at 0" in group["headline"]
        assert "The tool does not touch in the first" in warnings and 'set contact = "fit" in [[curve]]' in warnings


@pytest.mark.parametrize(("law", "by_force", "tries"), [("neo-hooke", False, 30), ("neo-hooke", True, 30), ("yeoh", False, 6)])
def test_the_interval_of_a_fit_includes_the_error_of_the_contact(law: str, by_force: bool, tries: int) -> None:
    """True constants lie within the intervals as often as stated, which they do not if the contact is taken as estimated."""
    depth = np.linspace(-0.3 * DEEPEST_M, 0.8 * DEEPEST_M, 60) if not by_force else np.linspace(0.05, 0.8, 40) * DEEPEST_M
    constants = TRUTH if law == "yeoh" else (TRUTH[0], 0.0)
    force = response().at_depth(depth, *constants)[0]
    shift, inside, contacts = 2e-4, 0, 0
    for seed in range(tries):
        random = np.random.default_rng(seed)
        if by_force:
            imposed, measured, sds = force, depth + shift + 5e-5 * random.standard_normal(len(depth)), (0.0, 5e-5)
        else:
            imposed, measured, sds = depth + shift, force + 0.01 * random.standard_normal(len(depth)), (0.0, 0.01)
        observed = Observed("a", imposed, measured, *sds, CurveModel(response(), by_force), contact_m=0.0)
        fit = least_squares_fit([observed], law=FIT_LAWS[law])
        inside += fit.profile_of_noise["C10_Pa"][0] < TRUTH[0] < fit.profile_of_noise["C10_Pa"][1]
        contact, half = contact_interval(observed, fit, 0)
        contacts += abs(contact - shift) < half
    assert min(inside, contacts) >= 0.8 * tries


def test_contact_is_of_a_tool_that_comes_into_contact(tmp_path: Path) -> None:
    from identify_cases import write_homogeneous

    folder = write_homogeneous(
        tmp_path / "a", "tension", "stretch,nominal_stress_Pa", np.array([1.0, 1.1, 1.2]), np.array([0.0, 1e3, 2e3])
    )
    file = folder / "dataset.toml"
    file.write_text(file.read_text("utf-8") + 'contact = "fit"\n', encoding="utf-8")
    with pytest.raises(ValueError, match=r"line .*: contact is for a tool that comes into contact; remove it"):
        read_dataset(folder)
