"""Answers that are stored: the next process loads them, with the same bits, and never another or a damaged one."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from explicitfe.fem.bones import distance
from explicitfe.platform.host import stored as module
from explicitfe.platform.host.stored import store_answers


@dataclass(frozen=True)
class Line:
    points: np.ndarray
    side: str
    tension: float | None = None


@dataclass(frozen=True)
class Body:
    lines: dict[str, tuple[Line, ...]]
    count: int


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    return tmp_path / "__pycache__"


def counted(calls: list[float], sources: tuple[str, ...] = ()) -> Callable[[np.ndarray, float], Body]:
    """A function that notes its calls, as a new process would have it."""

    @store_answers(Body, Line, sources=sources)
    def body_of(points: np.ndarray, tension: float = 0.1) -> Body:
        calls.append(tension)
        return Body({"a": (Line(points[::2], "left", tension), Line(points[:0], "right")), "b": ()}, len(points))

    return body_of


def test_the_next_process_loads_the_same_bits(folder: Path) -> None:
    calls: list[float] = []
    points = np.random.default_rng(1).normal(size=(7, 3)) / 3.0
    new = counted(calls)(points, 0.1)
    loaded = counted(calls)(points.copy(), 0.1)
    assert calls == [0.1] and len(list(folder.glob("*.stored"))) == 1
    for body in (new, loaded):
        left, right = body.lines["a"]
        assert left.points.tobytes() == points[::2].tobytes() and right.points.shape == (0, 3)
        assert (left.tension, right.tension, left.side, body.lines["b"], body.count) == (0.1, None, "left", (), 7)
        with pytest.raises(ValueError, match="read-only"):
            left.points[0] = 0.0


def test_other_inputs_and_other_code_have_other_answers(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[float] = []
    points = np.zeros((4, 3))
    for inputs in ((points, 0.1), (points, np.nextafter(0.1, 1.0)), (np.nextafter(points, 1.0), 0.1), (points[:3], 0.1)):
        counted(calls)(*inputs)
    assert len(calls) == 4
    (folder / "code").mkdir()
    (folder / "code" / "one.py").write_text("one = 1")
    monkeypatch.setattr(module, "_PACKAGE", folder)
    (folder / "platform" / "host").mkdir(parents=True)
    (folder / "platform" / "host" / "stored.py").write_text("")
    for text, count in (("one = 1", 5), ("one = 2", 6), ("one = 1", 6)):
        (folder / "code" / "one.py").write_text(text)
        module._circumstances.cache_clear()
        counted(calls, ("code",))(points, 0.1)
        assert len(calls) == count
    module._circumstances.cache_clear()


def test_a_damaged_or_foreign_file_is_computed_again(folder: Path) -> None:
    calls: list[float] = []
    points = np.arange(12.0).reshape(4, 3)
    counted(calls)(points, 0.1)
    (file,) = folder.glob("*.stored")
    whole = file.read_bytes()
    damaged = [
        whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :] for place in (0, 90, len(whole) // 2, len(whole) - 1)
    ]
    counted([])(points, 0.2)
    (other,) = set(folder.glob("*.stored")) - {file}
    for content in (*damaged, whole[: len(whole) // 2], b"", other.read_bytes()):
        file.write_bytes(content)
        before = len(calls)
        assert counted(calls)(points, 0.1).lines["a"][0].points.tobytes() == points[::2].tobytes()
        assert len(calls) == before + 1 and file.read_bytes() == whole


def test_without_a_folder_answers_are_computed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[float] = []
    monkeypatch.setattr(module, "kernel_folder", lambda: None)
    for _ in range(2):
        assert counted(calls)(np.zeros((2, 3)), 0.1).count == 2
    folder.write_text("a file in the place of the folder")
    monkeypatch.undo()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(folder.parent))
    assert counted(calls)(np.zeros((2, 3)), 0.1).count == 2
    assert len(calls) == 3


def test_what_was_not_used_for_longest_gives_room(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[float] = []
    for number in range(3):
        counted(calls)(np.zeros((1000, 3)), float(number))
        for file in folder.glob("*.stored"):
            os.utime(file, ns=(file.stat().st_atime_ns, file.stat().st_mtime_ns - 10**9))
    counted(calls)(np.zeros((1000, 3)), 0.0)  # the first is used again
    monkeypatch.setattr(module, "MOST_STORED_BYTES", 2.5 * max(file.stat().st_size for file in folder.glob("*.stored")))
    counted(calls)(np.zeros((1000, 3)), 3.0)
    assert len(list(folder.glob("*.stored"))) == 2
    for number, count in ((0.0, 4), (3.0, 4), (1.0, 5)):
        counted(calls)(np.zeros((1000, 3)), number)
        assert len(calls) == count


def test_the_field_of_a_bone_is_stored(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that finds the field never computes it, and has it to the last bit; a scenario that moves the bone shares it."""
    x, y, z = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 4]], dtype=float).T * 1e-2
    points = np.column_stack([x, y, z])
    surface = distance.TriangleSurface(points, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    body = points + np.array([0.0, 0.0, 0.05])
    region, numbers = np.array([[-0.01] * 3, [0.05] * 3]), (2e-3, 1e-3)
    computed = distance.distance_field(surface, region=region, spacing_m=numbers[0], smoothing_m=numbers[1])
    first = distance._field.__wrapped__(surface, region, *numbers)
    distance.bone_field(surface, "bone", body, spacing_m=2e-3)
    monkeypatch.setattr(distance, "distance_field", lambda *_, **__: pytest.fail("computed again"))
    loaded = distance._field.__wrapped__(surface, region, *numbers)
    for field in (first, loaded):
        assert field.values.tobytes() == computed.values.tobytes() and field.origin_m.tobytes() == computed.origin_m.tobytes()
        assert field.spacing_m == computed.spacing_m
