"""Damaged result files: a sentence or a right answer, never a traceback, a wrong number, or the end of the process."""

from __future__ import annotations

import os
from collections import Counter

import h5py
import numpy as np
import pytest
from damage import damages, outcome, read_all, readings, structure_bytes
from old_layout import write_old
from tiny_result import MESH, E, N, add, displacement, start, write

from explicitfe.platform.errors import InputError
from explicitfe.results.files import open_result
from explicitfe.results.files.layout import RESTART_SLOTS

pytestmark = pytest.mark.slow

needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="each reading is a process of its own")


@needs_fork
@pytest.mark.parametrize("kind", ["finished", "killed"])
def test_a_damaged_file_is_a_sentence_or_a_right_answer(tmp_path, kind):
    """The long study of the same is studies/benchmarks/damaged_files.py."""
    with start(tmp_path / "a.vtkhdf") as run:
        for step in range(3):
            add(run, step)
        path = run.finish("finished", "", {"steps": 3}) if kind == "finished" else run.running_path
    calls = readings(path)
    truth = read_all(path, calls)
    assert not [value for value in truth.values() if isinstance(value, InputError)]
    with open_result(path) as result:
        older = [None, *result.restart_states()]
    counts: Counter[str] = Counter()
    wanted = {"cut": 15, "byte": 15, "structure byte": 15, "structure bytes": 15, "block": 5}
    for damage in damages(path, np.random.default_rng(18), wanted):
        damaged = tmp_path / "damaged.vtkhdf"
        damaged.write_bytes(damage.data)
        came_to, what = outcome(damaged, calls, truth, older)
        assert came_to in ("right", "sentence"), f"{damage.kind}: {came_to}: {what}"
        counts[came_to] += 1
    assert min(counts["right"], counts["sentence"]) > 5


def test_every_number_is_compared_with_its_checksum(tmp_path):
    """A bit of each dataset that is read is turned: whoever reads it is told, and all else is as it was."""
    path = write(tmp_path / "a.vtkhdf", 3)
    whole = path.read_bytes()
    calls = readings(path)
    truth = read_all(path, calls)
    places = {}
    with h5py.File(path) as file:
        own = "explicitfe"
        names = ["VTKHDF/Points", "VTKHDF/Connectivity", f"{own}/node_sets/jaw", f"{own}/named_points/tip", f"{own}/scenario"]
        for name in [*names, f"{own}/model", f"{own}/provenance"]:
            places[name] = file[name].id.get_offset()
        for name in ("VTKHDF/PointData/velocity", "VTKHDF/CellData/J", f"{own}/history/kinetic_energy", f"{own}/status/ending"):
            places[name] = file[name].id.get_chunk_info(0).byte_offset
    for name, place in places.items():
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        values = read_all(path, calls)
        told = {key for key, value in values.items() if isinstance(value, InputError)}
        assert told, name
        assert "inspect" in told or name.startswith(("VTKHDF/PointData", "VTKHDF/CellData")), name
        for key in values.keys() - told:
            np.testing.assert_equal(values[key], truth[key])
        if name == "VTKHDF/PointData/velocity":
            assert told == {"velocity 0"}


def test_what_hdf5_arranges_is_checked_by_hdf5(tmp_path):
    """All but the lists of chunks has a checksum of the library; of what it has none, nothing but chunks is said."""
    path = write(tmp_path / "a.vtkhdf", 3)
    data = path.read_bytes()
    structure = bytes(data[place] for place in structure_bytes(path))
    assert data[8] == 2  # of the superblock
    assert b"OHDR" in structure
    for unchecked in (b"SNOD", b"HEAP", b"GCOL"):  # symbol tables and heaps of old files
        assert unchecked not in structure


def test_a_damaged_root_group_is_a_sentence(tmp_path):
    """Its checksum is wrong: HDF5 opens the file and fails at the first group, which was a KeyError."""
    data = bytearray(write(tmp_path / "a.vtkhdf", 1).read_bytes())
    data[data.index(b"OHDR") + 8] ^= 1  # the header of the root group is the first one
    (tmp_path / "b.vtkhdf").write_bytes(data)
    with pytest.raises(InputError, match=r"b\.vtkhdf is damaged"):
        open_result(tmp_path / "b.vtkhdf")


@pytest.mark.parametrize("number", [1, 2])
def test_old_formats_are_read(tmp_path, number):
    with open_result(write_old(tmp_path / "old.vtkhdf", 3, number=number)) as result:
        assert (result.format, result.status, result.message, result.summary) == (number, "finished", "größer", {"steps": 3})
        np.testing.assert_array_equal(result.times, [0.0, 1e-3, 2e-3])
        np.testing.assert_array_equal(result.displacement(1), displacement(1))
        np.testing.assert_array_equal(result.history("kinetic_energy"), np.arange(4) + 0.5)
        np.testing.assert_array_equal(result.probe("tip"), [displacement(step)[11] for step in range(3)])
        np.testing.assert_array_equal(result.mesh.named_points["tip"].position, MESH.points[[11]])
        assert result.fields["J"].quantity.unit == "m"
        state = result.restart_state()
        assert (state.sequence, state.stored_at, state.arrays) == (3, None, {"step": 2})
        assert result.contents()["history_rows"] == 4
        assert result.mesh_at(2).n_cells == E


def put(name, value):
    def edit(file):
        if name in file:
            del file[name]
        if value is not None:
            file[name] = value

    return edit


def attribute(name, key, value):
    def edit(file):
        if value is None:
            del file[name].attrs[key]
        else:
            file[name].attrs[key] = value

    return edit


def both(one, other):
    return lambda file: (one(file), other(file))


HUGE, BONE = 10**15, "explicitfe/bones/a"


def huge(name, dtype=float):
    def edit(file):
        del file[name]
        file.create_dataset(name, shape=(HUGE, 3), chunks=(1000, 3), dtype=dtype)

    return edit


DAMAGES = {
    "no state": put("explicitfe/status/state", None),
    "state a number": put("explicitfe/status/state", 3),
    "no message": put("explicitfe/status/message", None),
    "no summary": put("explicitfe/status/summary", None),
    "summary no JSON": put("explicitfe/status/summary", b"{"),
    "summary no table": put("explicitfe/status/summary", b"[1]"),
    "summary nested": put("explicitfe/status/summary", b"[" * 100_000),
    "summary no UTF-8": put("explicitfe/status/summary", b"\xff\xfe"),
    "no model": put("explicitfe/model", None),
    "model no JSON": put("explicitfe/model", "x"),
    "NSteps text": attribute("VTKHDF/Steps", "NSteps", "three"),
    "NSteps -1": attribute("VTKHDF/Steps", "NSteps", -1),
    "NSteps 1e9": attribute("VTKHDF/Steps", "NSteps", 10**9),
    "NSteps 2": attribute("VTKHDF/Steps", "NSteps", 2),
    "NSteps 1.5": attribute("VTKHDF/Steps", "NSteps", 1.5),
    "NSteps several": attribute("VTKHDF/Steps", "NSteps", [1, 2]),
    "no NSteps": attribute("VTKHDF/Steps", "NSteps", None),
    "format text": attribute("explicitfe", "format", "two"),
    "no format": attribute("explicitfe", "format", None),
    "no unit": attribute("VTKHDF/PointData/velocity", "unit", None),
    "no description": attribute("explicitfe/history/time", "description", None),
    "no rows": attribute("explicitfe/history", "rows", None),
    "rows 1e9": attribute("explicitfe/history", "rows", 10**9),
    "no sha256": attribute("explicitfe/scenario", "sha256", None),
    "Connectivity not of hexes": put("VTKHDF/Connectivity", np.arange(15)),
    "Connectivity out of range": put("VTKHDF/Connectivity", np.full(16, N)),
    "Connectivity negative": put("VTKHDF/Connectivity", np.full(16, -1)),
    "Connectivity of numbers": put("VTKHDF/Connectivity", np.zeros(16)),
    "Connectivity missing": put("VTKHDF/Connectivity", None),
    "Points in a plane": put("VTKHDF/Points", np.zeros((N, 2))),
    "Points of text": put("VTKHDF/Points", "x"),
    "Points not finite": put("VTKHDF/Points", np.full((N, 3), np.nan)),
    "Points huge": huge("VTKHDF/Points"),
    "Points a group": both(put("VTKHDF/Points", None), put("VTKHDF/Points/x", 1.0)),
    "times fall": put("VTKHDF/Steps/Values", np.array([2.0, 1.0, 0.0])),
    "times of whole numbers": put("VTKHDF/Steps/Values", np.arange(3)),
    "field huge": huge("VTKHDF/PointData/velocity"),
    "field of the wrong type": put("VTKHDF/CellData/J", np.zeros(3 * E, dtype=np.int32)),
    "no displacement": put("VTKHDF/PointData/displacement", None),
    "PointData no group": put("VTKHDF/PointData", 1.0),
    "node set out of range": put("explicitfe/node_sets/jaw", np.array([N])),
    "named point of two numbers": put("explicitfe/named_points/tip", np.zeros(2)),
    "named point in no element": put("explicitfe/named_points/tip", np.array([7.0, 0.0, 0.0, 0.0])),
    "named point not finite": put("explicitfe/named_points/tip", np.full(4, np.nan)),
    "bone of no node": both(put(f"{BONE}/points", np.zeros((2, 3))), put(f"{BONE}/triangles", np.array([[0, 1, 2]]))),
}


@pytest.mark.parametrize("what", DAMAGES)
def test_each_damage_is_told_in_a_sentence(tmp_path, what):
    """In a file of format 2, of which nothing is known but what stands in it."""
    path = write_old(tmp_path / "old.vtkhdf", 3)
    calls = readings(path) | {"bones": lambda r: [*r.bones]}
    with h5py.File(path, "r+") as file:
        DAMAGES[what](file)
    sentences = {str(value) for value in read_all(path, calls).values() if isinstance(value, InputError)}
    assert sentences
    assert all(sentence.startswith(f"{path} ") and "\n" not in sentence for sentence in sentences)


def test_a_restart_state_of_anything_is_passed_over(tmp_path):
    path = write(tmp_path / "a.vtkhdf", 2)
    for change in (put(f"{RESTART_SLOTS[1]}/seal", None), put(f"{RESTART_SLOTS[0]}/seal", np.array([1.5, 2.5]))):
        with h5py.File(path, "r+") as file:
            change(file)
    with open_result(path) as result:
        assert result.restart_state() is None


def link(name, target):
    """Replace a part by a link: to another name, or to the same name in another file."""

    def edit(file, other):
        del file[name]
        file[name] = h5py.SoftLink(target) if target else h5py.ExternalLink(str(other), name)

    return edit


def external_dataset(name):
    """Replace a dataset by one whose numbers are in a file of their own."""

    def edit(file, other):
        shape, kind = file[name].shape, file[name].dtype
        del file[name]
        file.create_dataset(name, shape=shape, dtype=kind, external=[(str(other), 0, h5py.h5f.UNLIMITED)])

    return edit


def virtual_dataset(name):
    """Replace a dataset by a virtual one of another file."""

    def edit(file, other):
        layout = h5py.VirtualLayout(shape=file[name].shape, dtype=file[name].dtype)
        layout[...] = h5py.VirtualSource(str(other), name, shape=file[name].shape)
        del file[name]
        file.create_virtual_dataset(name, layout)

    return edit


LINKS = {
    "external link": link("VTKHDF/Points", None),
    "external group": link("explicitfe/history", None),
    "external root group": link("explicitfe", None),
    "soft link": link("explicitfe/node_sets/jaw", "/explicitfe/node_sets/hyoid"),
    "dangling soft link": link("explicitfe/scenario", "/nothing"),
    "external dataset": external_dataset("VTKHDF/Points"),
    "virtual dataset": virtual_dataset("VTKHDF/Points"),
}


@pytest.mark.parametrize("kind", LINKS)
def test_other_files_are_never_read(tmp_path, kind):
    """Whoever sends a result could otherwise make its reader open any file; the other file is a whole result here."""
    path, other = write(tmp_path / "a.vtkhdf", 2), write(tmp_path / "other.vtkhdf", 2)
    calls = readings(path)
    with h5py.File(path, "r+") as file:
        LINKS[kind](file, other)
    sentences = {str(value) for value in read_all(path, calls).values() if isinstance(value, InputError)}
    assert len(sentences) >= 1
    assert all("is a link to another place" in text or "are in another file" in text for text in sentences), sentences
