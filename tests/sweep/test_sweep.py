"""A sweep from its scenario to its table: stored row by row, gone on with, merged; the same whoever computes it."""

from __future__ import annotations

import csv
import json
import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import own_measures
import pytest
from answers import check_answer
from command import command
from support import ROOT

import explicitfe
from explicitfe.platform.errors import InputError, MachineError
from explicitfe.results.files import open_result
from explicitfe.results.measure.measure import measure
from explicitfe.results.measure.numbers import flat
from explicitfe.simulate.sweep import rows
from explicitfe.simulate.sweep.definition import define
from explicitfe.simulate.sweep.journal import Journal, Stored
from explicitfe.simulate.sweep.members import Members
from explicitfe.simulate.sweep.rows import Member, Task, counted_causes, row_of, written

SCENARIO = ROOT / "scenarios" / "vowel-i.toml"
SMALL = ["model.cells=[8,4,4]", "analysis.duration_ms=4"]
TETRAHEDRON = "v 0 0 90\nv 9 0 90\nv 0 9 90\nv 0 0 99\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
FORCES = ["muscle.GGp.force_N=0:4:5"]
# A step of force at the ends of fibres folds elements if it is as large as this; the other force no scenario can have.
STEP = [f"muscle.GGp.{key}" for key in ("profile=step", "rise_ms=0", "distribution=ends")]
FOLDING, REFUSED = "400.0", "-1.0"


@pytest.fixture(scope="module")
def executor():
    """One of the user's: a thread of this process, which knows the machine code already."""
    with ThreadPoolExecutor(1) as pool:
        yield pool


def sweep(out: Path, executor, vary=FORCES, more=(), **options) -> list[dict]:
    """The rows of the runs that are computed now."""
    runs = explicitfe.sweep(SCENARIO, vary, out=out, settings=[*SMALL, *more], executor=executor, **options)
    missing = [member.number for member in runs.members()]
    rows = list(runs)
    assert len(rows) == len(runs)
    return [row for row in rows if row["member"] in missing]


def table(out: Path) -> list[dict[str, str]]:
    with (out / "table.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def journal_of(out: Path) -> Path:
    return out / "rows" / "all.jsonl"


@pytest.fixture(scope="module")
def whole(executor, tmp_path_factory) -> Path:
    """A sweep that nothing has disturbed."""
    out = tmp_path_factory.mktemp("sweep") / "whole"
    sweep(out, executor)
    return out


def test_rows_come_as_they_finish_and_make_a_table(whole):
    rows = table(whole)
    assert [row["member"] for row in rows] == list("01234")
    assert [float(row["muscle.GGp.force_N"]) for row in rows] == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert {row["status"] for row in rows} == {"finished"}
    forward = [float(row["points.back.forward_mm"]) for row in rows]
    assert np.all(np.diff(forward) > 0.0)  # the posterior genioglossus draws the back of the tongue forward
    assert not {"wall_s", "member_s"} & rows[0].keys()
    parquet = pytest.importorskip("pyarrow.parquet").read_table(whole / "table.parquet").to_pydict()
    assert list(parquet) == list(rows[0])
    assert parquet["points.back.forward_mm"] == forward


def test_a_row_is_what_a_run_measures(whole, tmp_path):
    """A member in memory, with one thread, and a run into a file."""
    summary = explicitfe.run(SCENARIO, out=tmp_path, settings=[*SMALL, "muscle.GGp.force_N=3.0", "analysis.threads=1"])
    row = table(whole)[3]
    measures = measure(Path(summary["result"]))
    for part in ("points", "highest", "grooves", "constriction", "contact", "body"):
        for name, value in flat(getattr(measures, part), part).items():
            assert row[name] == ("" if value is None else str(value)), name
    assert int(row["steps"]) == summary["steps"]
    assert float(row["min_J"]) == summary["min_J"]


def test_a_sweep_that_is_there_computes_nothing(whole, executor, tmp_path):
    out = shutil.copytree(whole, tmp_path / "again")
    before = (out / "table.csv").read_bytes()
    assert sweep(out, executor) == []
    assert (out / "table.csv").read_bytes() == before


@pytest.mark.parametrize("torn", [1, 40, 700, 5000])
def test_a_sweep_goes_on_after_a_kill(whole, executor, tmp_path, torn):
    """Whatever a kill leaves of the journal: what is whole there is not computed again, and the table is the same."""
    out = tmp_path / "killed"
    shutil.copytree(whole, out)
    (out / "table.csv").unlink()
    text = journal_of(out).read_bytes()[:-torn]
    journal_of(out).write_bytes(text)
    kept = sum(line.startswith('{"crc32"') for line in text.decode().splitlines(keepends=True) if line.endswith("\n"))
    assert len(sweep(out, executor)) == 5 - kept
    assert (out / "table.csv").read_bytes() == (whole / "table.csv").read_bytes()


def test_a_table_that_lacks_members_has_another_name(whole, executor, tmp_path):
    out = shutil.copytree(whole, tmp_path / "partly")
    for path in (out / "table.csv", out / "table.parquet", journal_of(out)):
        path.unlink()
    list(explicitfe.sweep(SCENARIO, FORCES, out=out, settings=SMALL, executor=executor, only="2/5"))
    assert not (out / "table.csv").exists() and not (out / "table.parquet").exists()
    assert (out / "table.partial.csv").read_text(encoding="utf-8").count("\n") == 2
    for share in ("1/5", "3/5", "4/5", "5/5"):
        list(explicitfe.sweep(SCENARIO, FORCES, out=out, settings=SMALL, executor=executor, only=share))
    assert (out / "table.csv").read_bytes() == (whole / "table.csv").read_bytes()
    assert not (out / "table.partial.csv").exists()


def test_a_member_that_fails_is_a_row(executor, tmp_path):
    out = tmp_path / "sweep"
    forces = [f"muscle.GGp.force_N=1.0,{FOLDING},{REFUSED}"]
    rows = sweep(out, executor, forces, STEP)
    by_force = {row["muscle.GGp.force_N"]: row for row in table(out)}
    assert len(rows) == 3
    assert by_force["1.0"]["status"] == "finished"
    assert by_force[FOLDING]["status"] == "inverted" and "inverted at a corner" in by_force[FOLDING]["message"]
    assert by_force[FOLDING]["points.tip.up_mm"] == ""
    assert by_force[REFUSED]["status"] == "refused"
    assert "muscle.GGp.force_N = -1.0" in by_force[REFUSED]["message"]
    assert "nan" not in (out / "table.csv").read_text(encoding="utf-8").lower()
    again = sweep(out, executor, forces, STEP, retry=True)
    assert sorted(row["status"] for row in again) == sorted(row["status"] for row in rows if row["status"] != "finished")
    assert len(table(out)) == 3


def test_results_are_kept_on_demand(executor, tmp_path):
    forces = [f"muscle.GGp.force_N=1.0,2.0,{FOLDING}"]
    sweep(tmp_path / "failed", executor, forces, STEP, keep="failed")
    (failed,) = (tmp_path / "failed" / "results").iterdir()
    with open_result(failed) as result:
        assert failed.name == "member-0000002.vtkhdf" and result.status != "finished"
    sweep(tmp_path / "every", executor, forces, STEP, keep="every:2")
    assert {path.name for path in (tmp_path / "every" / "results").iterdir()} == {
        "member-0000000.vtkhdf", "member-0000002.vtkhdf"
    }  # fmt: skip
    with pytest.raises(InputError, match="`keep` some"):
        sweep(tmp_path / "some", executor, keep="some")


def test_a_tool_on_a_specimen(executor, tmp_path):
    small = ["model.edge_size_mm=3", "analysis.forces_N=[0.05,0.1]", "model.material.C10_Pa=190"]
    rows = list(
        explicitfe.sweep("indentation-rear", ["model.material.C20_Pa=80,120"], out=tmp_path, settings=small, executor=executor)
    )
    soft, stiff = sorted(rows, key=lambda row: row["member"])
    assert {row["status"] for row in rows} == {"finished"}
    assert soft["load.2.force_N"] == pytest.approx(0.1, rel=1e-3)
    assert soft["load.2.displacement_mm"] > stiff["load.2.displacement_mm"] > soft["load.1.displacement_mm"]


def test_another_sweep_is_not_mixed_in(whole, executor):
    for change, words in (
        ({"vary": ["muscle.GGp.force_N=0:4:6"]}, "another sweep"),
        ({"vary": ["muscle.GGa.force_N=0:4:5"]}, "another sweep"),
        ({"measures": ["points"]}, "another sweep"),
    ):
        with pytest.raises(InputError, match=words):
            sweep(whole, executor, **change)


def test_a_folder_of_something_else_is_left_alone(executor, tmp_path):
    (tmp_path / "thesis.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match="contains other files"):
        sweep(tmp_path, executor)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_disk_that_is_full_loses_nothing(whole, executor, tmp_path, monkeypatch):
    out = shutil.copytree(whole, tmp_path / "full")
    journal_of(out).unlink()
    (out / "table.csv").unlink()
    written = []

    def fills(journal, rows):
        if written:
            raise MachineError("no room")
        written.append(rows)
        add(journal, rows)

    add = Journal.append
    monkeypatch.setattr(Journal, "append", fills)
    with pytest.raises(MachineError, match="no room"):
        sweep(out, executor)
    assert len(Stored(out / "rows")) == len(written[0])
    assert not (out / "table.csv").exists()
    monkeypatch.undo()
    assert len(sweep(out, executor)) == 5 - len(written[0])
    assert (out / "table.csv").read_bytes() == (whole / "table.csv").read_bytes()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--vary", "muscle.XX.force_N=1,2"], 'unknown muscle "XX"'),
        (["--vary", "analysis.duratoin_ms=1,2"], "duratoin_ms"),
        (["--vary", "muscle.GGp.force_N=4:1:3"], "the range is empty"),
        (["--table", "nowhere.csv"], "nowhere.csv"),
        ([], "no factor is given"),
        (["--vary", "muscle.GGp.force_N=1,2", "--random", "2", "--morris", "3"], "different designs"),
        (["--vary", "muscle.GGp.force_N=1,2", "--measure", "tip"], "unknown measure"),
        (["--vary", "muscle.GGp.force_N=1,2", "--retry", "all"], "the only valid value is failed"),
        (["--vary", "muscle.GGp.force_N=1,2", "--only", "3/2"], "Write K/N"),
        (["--vary", "muscle.GGp.force_N=1,2", "--processes", "0"], "--processes 0"),
        (
            ["--vary", "muscle.GGp.force_N=1,2", "--processes", "1", "--scheduler", "tcp://a:1"],
            "the scheduler has its own workers",
        ),
    ],
)
def test_bad_input_is_one_sentence(options, words, tmp_path, capsys):
    out = tmp_path / "out"
    assert command(["sweep", str(SCENARIO), *options, "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert not list(out.rglob("*.jsonl")) and not (out / "table.csv").exists()


def test_the_list_of_what_is_to_be_computed(whole, tmp_path, capsys):
    words = ["sweep", str(SCENARIO), "--vary", FORCES[0], "--set", SMALL[0], "--set", SMALL[1], "--json", "--list"]
    assert command([*words, "--out", str(tmp_path / "new")]) == 0
    listed = check_answer("sweep", capsys.readouterr().out)
    assert [member["member"] for member in listed["members"]] == [0, 1, 2, 3, 4]
    assert "muscle.GGp.force_N=4.0" in listed["members"][4]["settings"]
    assert len({member["name"] for member in listed["members"]}) == 5
    assert command([*words, "--out", str(whole)]) == 0
    assert json.loads(capsys.readouterr().out)["members"] == []


def test_columns_do_not_depend_on_who_came_first(executor, tmp_path):
    """A member that failed has fewer columns; whether its row came first is not seen in the table."""
    forces = [f"muscle.GGp.force_N={REFUSED},1.0,2.0"]
    sweep(tmp_path / "a", executor, forces)
    for share in ("3/3", "2/3", "1/3"):
        sweep(tmp_path / "b", executor, forces, only=share)
    assert (tmp_path / "a" / "table.csv").read_bytes() == (tmp_path / "b" / "table.csv").read_bytes()


def test_causes_are_counted_without_their_numbers():
    messages = ["at 1.5 ms element 3 folded.", "at 2 ms element 17 folded.", 'unknown material "nobody-1999"']
    assert counted_causes(messages) == {"at # ms element # folded.": 2, 'unknown material "nobody-1999"': 1}
    assert counted_causes(messages[:1]) == {messages[0]: 1}  # with its numbers where there is one of them


def test_a_table_is_written_by_whoever_sees_all_rows(whole, tmp_path):
    """A command that read the journals before the last row came does not take the table away."""
    out = shutil.copytree(whole, tmp_path / "out")
    for path in (out / "table.csv", out / "table.parquet"):
        path.unlink()
    lines = journal_of(out).read_text().splitlines(keepends=True)
    journal_of(out).write_text("".join(lines[:-1]))
    behind = explicitfe.sweep(SCENARIO, FORCES, out=out, settings=SMALL, only="1/5")
    journal_of(out).write_text("".join(lines))  # another command's last row
    assert explicitfe.sweep(SCENARIO, FORCES, out=out, settings=SMALL, only="2/5").finish()["complete"]
    assert behind.finish()["complete"]
    assert (out / "table.csv").read_bytes() == (whole / "table.csv").read_bytes()


def test_rows_of_several_shares_in_any_order(tmp_path):
    for number in range(7):
        with Journal(tmp_path / f"{number}-of-7.jsonl") as journal:
            journal.append([written({"member": number, "status": "finished"})])
    stored = Stored(tmp_path)
    assert [row["member"] for row in stored.rows()] == list(range(7))
    assert [row["member"] for row in stored.rows([6, 0, 6, 3])] == [6, 0, 6, 3]


def test_the_later_row_counts_whatever_its_journal_is_called(tmp_path):
    for at, (name, status) in enumerate([("all", "lost"), ("1-of-2", "inverted")]):
        with Journal(tmp_path / f"{name}.jsonl") as journal:
            journal.append([written({"member": 0, "status": status})])
        os.utime(tmp_path / f"{name}.jsonl", (at, at))
    assert [row["status"] for row in Stored(tmp_path).rows()] == ["inverted"]


def test_files_that_only_later_members_name_belong_to_the_sweep(tmp_path):
    for name in ("a", "b"):
        (tmp_path / f"{name}.obj").write_text(TETRAHEDRON)
    scenario = tmp_path / "s.toml"
    scenario.write_text(SCENARIO.read_text().replace('name = "palate"', 'name = "roof"\nlength_unit = "mm"\nfile = "a.obj"'))
    sums = define(scenario, (), from_levels("bone.roof.file", "a.obj", "b.obj"), design="grid", measures=("points",)).file_sums
    assert set(sums) == {"a.obj", "b.obj"}


def from_levels(key: str, *levels: str) -> Members:
    return Members((key,), [(level,) for level in levels])


def test_a_second_walk_and_the_same_sweep_of_a_command_compute_nothing(executor, tmp_path):
    """Python quotes the words of settings and a command does not; both yield the stored rows."""
    small = [*SMALL, "model.element=hex8"]
    both = explicitfe.sweep(SCENARIO, ["muscle.GGp.force_N=1,2"], out=tmp_path, settings=small, executor=executor)
    assert [row["muscle.GGp.force_N"] for row in both] == [1, 2]
    same = {"model.cells": [8, 4, 4], "analysis.duration_ms": 4, "model.element": "hex8"}
    again = explicitfe.sweep(SCENARIO, {"muscle.GGp.force_N": [1, 2]}, out=tmp_path, settings=same, executor=executor)
    assert list(both) == list(again) and [row["status"] for row in again] == ["finished"] * 2
    assert journal_of(tmp_path).read_text().count("crc32") == 2


def test_a_muscle_that_the_scenario_does_not_list_is_named(executor, tmp_path):
    runs = explicitfe.sweep(SCENARIO, ["muscle.STY.force_N=1,2"], out=tmp_path, settings=SMALL, executor=executor)
    assert runs.finish()["added_muscles"] == ["STY"]


def test_results_that_are_asked_for_later_are_computed_then(executor, tmp_path):
    forces = [f"muscle.GGp.force_N=1.0,{REFUSED}"]
    sweep(tmp_path, executor, forces)
    assert not list((tmp_path / "results").iterdir())
    assert len(sweep(tmp_path, executor, forces, keep="all")) == 1  # one that is refused has no result
    assert [path.name for path in (tmp_path / "results").glob("*.vtkhdf")] == ["member-0000000.vtkhdf"]
    assert sweep(tmp_path, executor, forces, keep="all") == []


def test_a_long_scenario_is_a_scenario(tmp_path):
    scenario = tmp_path / "long.toml"
    scenario.write_text(SCENARIO.read_text() + "# a remark\n" * 3000)
    explicitfe.sweep(scenario, FORCES, out=tmp_path / "out", settings=SMALL)
    explicitfe.sweep(scenario, FORCES, out=tmp_path / "out", settings=SMALL)


def test_what_a_measure_writes_into_its_arrays_is_its_own(executor, tmp_path):
    row = sweep(tmp_path / "a", executor, ["muscle.GGp.force_N=1"], measures=[own_measures.spoils, own_measures.rise])[0]
    assert row["spoils.most_mm"] == pytest.approx(1e3 * row["rise.most_mm"])


@pytest.mark.parametrize(
    ("error", "kept"), [(AssertionError("no"), "fault"), (EOFError("end"), "fault"), (OSError(28, "full"), "")]
)
def test_whatever_goes_wrong_with_a_member(monkeypatch, tmp_path, error, kept):
    def fails(*words):
        raise error

    monkeypatch.setattr(rows, "_computed", fails)
    task = Task(SCENARIO, SCENARIO.read_text(), ("points",), tmp_path)
    if kept:
        assert row_of(task, Member(3, "", ()))["status"] == kept
    else:  # no member is to blame for a disk that is full
        with pytest.raises(MachineError):
            row_of(task, Member(3, "", ()))
