"""Two results compared: fields that are known by formula, on one mesh and on two, at the same times and at others."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import tiny_result
from answers import check_answer
from command import command
from support import ROOT

from explicitfe.fem.mesh.box import box
from explicitfe.platform.errors import InputError
from explicitfe.results.files import FINISHED, Quantity
from explicitfe.results.files.differing_keys import differing_keys
from explicitfe.results.measure.compare import compare
from explicitfe.simulate.scenario.read import read_scenario

SIZE_M = np.array([0.04, 0.03, 0.02])
GRADIENT = np.array([[0.02, 0.01, -0.03], [0.0, 0.04, 0.01], [0.05, -0.02, 0.0]])
COARSE, FINE = (2, 2, 1), (5, 3, 4)


def write(
    path: Path, cells=COARSE, times_s=(0.0, 0.01, 0.02), offset_m=(0.0, 0.0, 0.0), size=SIZE_M, scenario=None, rate=1.0
) -> Path:
    """A block whose nodes at X are displaced by rate * t / 20 ms times the gradient at X, and by the offset at the last time."""
    mesh = box(cells, list(size))
    mesh = mesh.with_named_nodes({"tip": int(np.argmin(mesh.points.sum(axis=1)))})
    probe = mesh.named_points["tip"].position[0]
    writer = tiny_result.start(
        path,
        mesh=mesh,
        point_fields={},
        cell_fields={"J": Quantity("1")},
        history={
            "kinetic_energy": Quantity("J"),
            "probe_tip_displacement": Quantity("m", 3),
            "probe_tip_velocity": Quantity("m/s", 3),
        },
        model={"scenario": {"analysis": {"type": "transient"}, **(scenario or {})}, "probes": {"tip": {}}},
        restart={"step": 0},
    )
    with writer as result:
        for number, time_s in enumerate(times_s):
            added = np.array(offset_m) * (number == len(times_s) - 1)
            share = rate * time_s / 0.02

            def moved(points: np.ndarray, share: float = share, added: np.ndarray = added) -> np.ndarray:
                return share * points @ GRADIENT.T + added

            row = {"kinetic_energy": 1.0 + number, "probe_tip_displacement": moved(probe), "probe_tip_velocity": np.zeros(3)}
            result.sample(time_s, row, {"displacement": moved(mesh.points)}, {"J": np.full(mesh.element_count, 1.0 + share)})
            result.restart({"step": number})
        return result.finish(FINISHED, "", {})


def displacement(comparison):
    return next(part for part in comparison.fields if part.name == "displacement")


def test_a_result_is_identical_to_itself_and_to_its_twin(tmp_path: Path) -> None:
    a, b = write(tmp_path / "a.vtkhdf"), write(tmp_path / "b.vtkhdf")
    comparison = compare(a, b, tolerance=0.0)
    assert comparison.identical and comparison.within_tolerance and comparison.points.same_mesh
    assert not comparison.differing_keys and not comparison.measures
    assert all(part.largest == part.rms == 0.0 for part in comparison.fields)


def test_a_known_difference_on_one_mesh(tmp_path: Path) -> None:
    """The last of three samples is shifted by a vector: that is the largest difference, and its rms is its length over root 3."""
    shift_m = np.array([-1e-3, 2e-4, 5e-4])
    a, b = write(tmp_path / "a.vtkhdf"), write(tmp_path / "b.vtkhdf", offset_m=shift_m)
    comparison = compare(a, b)
    part, length = displacement(comparison), np.linalg.norm(shift_m)
    assert not comparison.identical and comparison.within_tolerance is None
    assert part.largest == pytest.approx(length) and part.rms == pytest.approx(length / np.sqrt(3.0)) and part.at_ms == 20.0
    points = box(COARSE, list(SIZE_M)).points
    largest = max(np.linalg.norm(points @ GRADIENT.T + added, axis=1).max() for added in (0.0, shift_m))
    assert part.share == pytest.approx(length / largest)
    tip = comparison.named_points["tip"]
    assert (tip.forward_mm, tip.right_mm, tip.up_mm) == pytest.approx((1.0, 0.2, 0.5)) and tip.largest_mm == pytest.approx(
        1e3 * length
    )
    column = next(part for part in comparison.history if part.name == "probe_tip_displacement")
    assert column.largest == pytest.approx(length) and column.at_ms == 20.0
    assert (
        compare(a, b, tolerance=part.share).within_tolerance and not compare(a, b, tolerance=0.999 * part.share).within_tolerance
    )
    forward = next(row for row in comparison.measures if row.measure == "points.tip.forward_mm")
    assert forward.b - forward.a == pytest.approx(1.0)


@pytest.mark.parametrize("cells", [(COARSE, FINE), (FINE, COARSE)], ids=["to a finer one", "to a coarser one"])
def test_two_meshes_are_compared_at_points_of_the_material(tmp_path: Path, cells) -> None:
    """Hexes hold a linear field exactly, whatever the mesh: what remains of two is rounding, or what was added to one."""
    a, b = write(tmp_path / "a.vtkhdf", cells[0]), write(tmp_path / "b.vtkhdf", cells[1])
    comparison = compare(a, b)
    assert not comparison.points.same_mesh and not comparison.identical and comparison.points.left_out == 0
    assert displacement(comparison).largest < 1e-15
    assert next(part for part in comparison.fields if part.name == "J").largest == 0.0
    shifted = write(tmp_path / "c.vtkhdf", cells[1], offset_m=(0.0, 3e-4, 0.0))
    assert displacement(compare(a, shifted)).largest == pytest.approx(3e-4)


def test_between_samples_the_second_is_interpolated(tmp_path: Path) -> None:
    """A motion that is linear in time is the same however it is sampled; what the second does not reach is left out."""
    a = write(tmp_path / "a.vtkhdf", times_s=(0.0, 0.004, 0.010, 0.017, 0.030))
    b = write(tmp_path / "b.vtkhdf", times_s=(0.0, 0.005, 0.010, 0.020))
    comparison = compare(a, b)
    times = comparison.times
    assert (times.compared, times.interpolated, times.last_ms, times.left_out) == (4, 2, pytest.approx(17.0), 1)
    assert displacement(comparison).largest < 1e-16 and not comparison.identical


def test_what_is_not_a_number_in_both_is_the_same(tmp_path: Path) -> None:
    a, b = (write(tmp_path / f"{name}.vtkhdf", rate=rate) for name, rate in (("a", np.nan), ("b", np.nan)))
    assert compare(a, b).identical
    assert displacement(compare(a, write(tmp_path / "c.vtkhdf"), tolerance=10.0)).largest == np.inf


def test_what_cannot_be_compared_is_refused(tmp_path: Path) -> None:
    a = write(tmp_path / "a.vtkhdf")
    other = write(tmp_path / "b.vtkhdf", FINE, size=8.0 * SIZE_M)
    with pytest.raises(InputError, match=r"not of the same body: 9\d % of the nodes of the first lie outside"):
        compare(other, a)
    punch = write(tmp_path / "c.vtkhdf", scenario={"analysis": {"type": "relaxation"}})
    with pytest.raises(InputError, match="one is a transient run, one an indentation"):
        compare(a, punch)
    with pytest.raises(InputError, match="no stored time of the first"):
        compare(a, write(tmp_path / "d.vtkhdf", times_s=(1.0, 2.0)))
    for share in (-0.1, np.nan, np.inf):
        with pytest.raises(InputError, match="`tolerance`"):
            compare(a, a, tolerance=share)


def test_keys_are_named_as_set_takes_them() -> None:
    one = {
        "title": "one",
        "model": {"resolution": "coarse", "gravity_m_s2": [0, 0, 0]},
        "muscle": [{"name": "GGp", "force_N": 1.0}, {"name": "SL", "force_N": 1.0}],
    }
    other = {
        "title": "other",
        "model": {"resolution": "coarse", "gravity_m_s2": [0, 0, -9.81], "damping": {"alpha_per_s": 40.0}},
        "muscle": [{"name": "GGp", "force_N": 2.0}, {"name": "STY", "force_N": 1.0}, {"name": "STY", "force_N": 0.5}],
    }
    assert differing_keys([one, one]) == {}
    assert differing_keys([one, other, one]) == {
        "model.gravity_m_s2": [[0, 0, 0], [0, 0, -9.81], [0, 0, 0]],
        "muscle.GGp.force_N": [1.0, 2.0, 1.0],
        "muscle.SL": [{"name": "SL", "force_N": 1.0}, None, {"name": "SL", "force_N": 1.0}],
        "model.damping": [None, {"alpha_per_s": 40.0}, None],
        "muscle.2": [None, {"name": "STY", "force_N": 1.0}, None],
        "muscle.3": [None, {"name": "STY", "force_N": 0.5}, None],
    }


def test_a_table_that_only_one_scenario_has_is_one_row(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The tables of bundled scenarios have dozens of keys once their defaults are filled in."""
    settings = ("muscle.+={name='STY', force_N=1.4}", "bone.jaw.friction=0.3", "effects.activation-lag.tau_ms=12.0")
    scenarios = (read_scenario(ROOT / "scenarios" / "vowel-i.toml", chosen)[0] for chosen in ((), settings))
    plain, changed = (scenario.model_dump(mode="json", by_alias=True) for scenario in scenarios)
    assert len(changed["muscle"][-1]) > 10
    assert list(differing_keys([plain, changed])) == ["muscle.STY", "bone.jaw.friction", "effects.activation-lag"]
    paths = [write(tmp_path / "a.vtkhdf", scenario=plain), write(tmp_path / "b.vtkhdf", scenario=changed, rate=1.1)]
    assert command(["compare", *map(str, paths), "--json"]) == 0
    rows = check_answer("compare", capsys.readouterr().out)["differing_keys"]
    assert [row["key"] for row in rows] == ["muscle.STY", "bone.jaw.friction", "effects.activation-lag"]
    assert command(["compare", *map(str, paths)]) == 0
    lines = [[cell.strip() for cell in line.split("│")[1:-1]] for line in capsys.readouterr().out.splitlines() if "│" in line]
    assert ["muscle.STY", "absent", "1.4 N"] in lines and ["effects.activation-lag", "absent", "tau_ms = 12"] in lines
    assert command(["report", *map(str, paths), "--out", str(tmp_path / "page.html")]) == 0
    assert "<td>1.4 N</td>" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_the_command_tells_a_script_by_its_exit_code(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    a = write(tmp_path / "a.vtkhdf", scenario={"muscle": [{"name": "GGp", "force_N": 1.0}]})
    b = write(tmp_path / "b.vtkhdf", FINE, offset_m=(1e-3, 0.0, 0.0), scenario={"muscle": [{"name": "GGp", "force_N": 1.5}]})
    words = ["compare", str(a), str(b), "--json"]
    assert command([*words, "--tolerance", "2"]) == 0
    answer = check_answer("compare", capsys.readouterr().out)
    assert answer["within_tolerance"] and answer["differing_keys"] == [{"key": "muscle.GGp.force_N", "a": 1.0, "b": 1.5}]
    assert command([*words, "--tolerance", "0.001"]) == 3
    shown = capsys.readouterr()
    failure = json.loads(shown.out)["failure"]
    assert (
        failure["kind"] == "check"
        and "differ by up to 1 mm" in failure["message"]
        and "more than the tolerance of 0.1 %" in shown.err
    )
    assert command(["compare", str(a), str(b)]) == 0
    table = capsys.readouterr().out
    assert "muscle.GGp.force_N" in table and "same material points" in table and "back 1.00, up 0.00 mm" in table


def test_indentations_are_compared_by_their_loads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    paths = []
    for name, factor in (("a", 1.0), ("b", 1.1)):
        paths.append(tmp_path / f"{name}.vtkhdf")
        history = {"force": Quantity("N"), "indentation": Quantity("m")}
        model = {"scenario": {"analysis": {"type": "relaxation"}}}
        with tiny_result.start(paths[-1], history=history, model=model, point_fields={}, cell_fields={}) as writer:
            for load in range(3):
                row = {"force": 0.1 * load, "indentation": factor * 1e-3 * load}
                writer.sample(float(load), row, {"displacement": tiny_result.displacement(load)}, {})
            writer.finish(FINISHED, "", {})
    comparison = compare(*paths)
    column = next(part for part in comparison.history if part.name == "indentation")
    assert column.largest == pytest.approx(2e-4) and column.share == pytest.approx(0.2 / 2.2) and not comparison.measures
    assert command(["compare", *map(str, paths)]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if "indentation" in line)
    assert [cell.strip() for cell in line.split("│")[1:-1]] == ["indentation", "0.2 mm", "9.09 %", "2 s"]
