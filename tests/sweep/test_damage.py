"""Damaged folders of sweeps: a sentence for each, and no changed digit in a table; rows of earlier versions are read."""

from __future__ import annotations

import json
import random
import re
import shutil
import warnings
from pathlib import Path

import pytest
from command import command
from written_sweeps import CELLS, FORCES, SCENARIO, write_sweep

import explicitfe
from explicitfe.platform.errors import InputError, RunWarning
from explicitfe.simulate.sweep import members as designs
from explicitfe.simulate.sweep.factors import factors_of
from explicitfe.simulate.sweep.journal import Stored

RUNS, ATTACKS = 12, 60
JUNK = [None, True, -1, 1e308, "x", [], {}, 10**30, [None], {"a": 1}]


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("damage") / "whole"
    return write_sweep(out, designs.random(factors_of(FORCES), RUNS, 0))


@pytest.fixture
def folder(whole, tmp_path) -> Path:
    return shutil.copytree(whole, tmp_path / "sweep")


def journal(folder: Path) -> Path:
    return folder / "rows" / "all.jsonl"


def finish(folder: Path):
    """Resume the sweep, all of whose rows are stored, and write its table."""
    return explicitfe.sweep(SCENARIO, FORCES, random=RUNS, settings=CELLS, out=folder).finish()


def without_checksums(folder: Path) -> Path:
    """Write the rows as earlier versions did."""
    text = journal(folder).read_text()
    journal(folder).write_text(re.sub(r'(?m)^\{"crc32": "[0-9a-f]{8}", "cells": (\[.*\])\}$', r"\1", text))
    return folder


def test_no_changed_digit_reaches_a_table(folder):
    text = journal(folder).read_bytes()
    places = [place for place, byte in enumerate(text) if chr(byte).isdigit()]
    for place in random.Random(0).sample(places, 200):
        changed = bytearray(text)
        changed[place] = ord("0") + (changed[place] - ord("0") + 5) % 10
        journal(folder).write_bytes(changed)
        with pytest.raises(InputError, match=r"all\.jsonl: line \d+ is damaged"):
            Stored(folder / "rows")


def test_a_damaged_row_is_computed_again_after_its_line_is_deleted(folder):
    lines = journal(folder).read_text().splitlines(keepends=True)
    number = next(number for number, line in enumerate(lines) if '"finished"' in line)
    lines[number] = lines[number].replace("0.9", "0.8")
    journal(folder).write_text("".join(lines))
    with pytest.raises(InputError, match=f"line {number + 1} is damaged.*Delete the line"):
        finish(folder)
    assert not (folder / "table.csv").exists()
    journal(folder).write_text("".join(lines[:number] + lines[number + 1 :]))
    assert len(Stored(folder / "rows")) == RUNS - 1


def test_rows_of_an_earlier_version_are_read_with_one_sentence(whole, folder, tmp_path, capsys):
    without_checksums(folder)
    with pytest.warns(RunWarning, match=f"{RUNS} rows were written by an earlier version without checksums"):
        finish(folder)
    finish(shutil.copytree(whole, tmp_path / "new"))
    assert (folder / "table.csv").read_bytes() == (tmp_path / "new" / "table.csv").read_bytes()
    assert command(["report", str(folder)]) == 0
    assert capsys.readouterr().err.count("without checksums") == 1


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (['{"columns": ["member", "status"]}', "[0]"], "line 2 is damaged"),
        (['{"columns": ["member", "status"]}', '[0, "finished", 1]'], "line 2 is damaged"),
        (['{"columns": ["member", "status"]}', "{}"], "line 2 is damaged"),
        (['{"columns": ["member", "status"]}', '[0.5, "finished"]'], "has no run 0.5"),
        (['{"columns": ["member", "status"]}', '[99, "finished"]'], "has no run 99"),
        (['{"columns": ["member", "status"]}', "[0, 1]"], "its status is no text"),
        (['{"columns": ["member", "status", "x"]}', '[0, "finished", NaN]'], "a cell is no number"),
        (['{"columns": ["member", "status", "x"]}', '[0, "finished", 1e999]'], "a cell is no number"),
        (['{"columns": ["member"]}', "[0]"], "line 1 is damaged"),
        (['{"columns": null}', '[0, "finished"]'], "line 1 is damaged"),
        (['{"columns": true}', "[0]"], "line 1 is damaged"),
        (["{}", "[0]"], "line 1 is damaged"),
        (['[0, "finished"]'], "it names no columns"),
    ],
)
def test_lines_that_are_no_rows(folder, lines, words):
    journal(folder).write_text("".join(f"{line}\n" for line in lines))
    with pytest.raises(InputError, match=words):
        Stored(folder / "rows", RUNS)


def test_a_folder_in_the_place_of_a_journal(folder, capsys):
    journal(folder).unlink()
    journal(folder).mkdir()
    assert command(["report", str(folder)]) == 2
    assert "all.jsonl: cannot be read" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["sweep.json", "members.csv", "rows/all.jsonl"])
@pytest.mark.parametrize("checksums", [True, False])
def test_any_damage_is_a_sentence(whole, tmp_path, capsys, name, checksums):
    """Changed bits, cuts, texts between others and other JSON values: each is a sentence, or does no harm."""
    rng = random.Random(f"{name} {checksums}")
    folder = tmp_path / "sweep"
    for _ in range(ATTACKS):
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(whole, folder)
        if not checksums:
            without_checksums(folder)
        (folder / name).write_bytes(damaged((folder / name).read_bytes(), rng))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RunWarning)
            try:
                finish(folder)
            except InputError:
                assert not (folder / "table.csv").exists()
    assert command(["report", str(folder)]) in (0, 2)
    assert "fault" not in capsys.readouterr().err


def damaged(data: bytes, rng: random.Random) -> bytes:
    """The bytes of a file after one change."""
    content, place = bytearray(data), rng.randrange(len(data))
    kind = rng.randrange(4)
    if kind == 0:
        content[place] ^= 1 << rng.randrange(8)
    elif kind == 1:
        del content[place:]
    elif kind == 2:
        content[place:place] = rng.choice([b"\n", b"\0", b'"', b",", b"[", b"{", b"9" * 400, b"NaN", b"1e999"])
    else:
        return with_other_json(data, rng)
    return bytes(content)


def with_other_json(data: bytes, rng: random.Random) -> bytes:
    """The bytes of a file with one JSON value, or a part of it, replaced or removed."""
    lines = data.splitlines(keepends=True)
    parts = [data] if data.startswith(b"{\n") else lines
    at = rng.randrange(len(parts))
    try:
        entry = json.loads(parts[at])
    except ValueError:  # a table (CSV)
        entry = parts[at].decode()
    if isinstance(entry, dict) and entry:
        entry[rng.choice([*entry])] = rng.choice(JUNK)
    elif isinstance(entry, list) and entry:
        entry[rng.randrange(len(entry))] = rng.choice(JUNK)
    else:
        entry = rng.choice(JUNK)
    return b"".join([*parts[:at], json.dumps(entry).encode() + b"\n", *parts[at + 1 :]])
