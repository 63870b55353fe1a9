"""Whatever stands in a scenario or behind --set: it runs, or is refused in one sentence; no traceback, and nobody waits."""

from __future__ import annotations

import json
import math
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace

import pytest
from support import ROOT

from explicitfe.fem.inputs.bounds import BOUNDS, bounds_of
from explicitfe.fem.mesh import size
from explicitfe.platform.errors import InputError, MachineError
from explicitfe.platform.host import memory, stopping
from explicitfe.simulate.run import outlook
from explicitfe.simulate.run.prepare import prepare
from explicitfe.simulate.run.run import run
from explicitfe.simulate.scenario.read import json_schema, read_scenario

pytestmark = pytest.mark.slow

VOWEL = ROOT / "scenarios" / "vowel-i.toml"
LONGEST_ANSWER_S = 10.0  # far above what a refusal takes on a busy machine, far below what nobody waits for
LONGEST_SENTENCE_CHARACTERS = 700

# Every table and key that takes a number.
TRANSIENT = {
    "title": "all keys",
    "model": {
        "name": "tongue",
        "cells": [8, 4, 4],
        "material": {"law": "yeoh", "C10_Pa": 1037.0, "C20_Pa": 486.0, "poisson": 0.49, "density_kg_m3": 1040.0},
        "damping": {"alpha_per_s": 40.0, "beta_s": 0.0, "tau_ms": 5.0},
        "attachment": "area",
        "gravity_m_s2": [0.0, 0.0, -9.81],
    },
    "muscle": [
        {"name": "GGp", "force_N": 1.0, "profile": "ramp", "start_ms": 1.0, "rise_ms": 5.0, "end_ms": 9.0, "fibres": [1, 2]},
        {"name": "STY", "force_N": 1.0, "profile": "table", "table": [[0.0, 0.0], [5.0, 1.0]], "distribution": "stress"},
    ],
    "bone": [{"name": "palate", "friction": 0.1, "shift_mm": [0.0, 0.0, 1.0], "hard_palate_mm": 30.0}],
    "jaw": {
        "opening_deg": 1.0,
        "forward_mm": 0.0,
        "down_mm": 0.0,
        "start_ms": 0.0,
        "rise_ms": 5.0,
        "axis_mm": [110.0, 0.0, 60.0],
    },
    "hyoid": {"stiffness_N_per_mm": 1.0},
    "lips": {"area_mm2": 30.0, "length_mm": 8.0},
    "resection": [{"box_mm": [[-99.0, 0.0, 80.0], [105.0, 99.0, 200.0]]}],
    "graft": [{"sphere": {"centre_mm": [80.0, 0.0, 90.0], "radius_mm": 12.0}, "stiffness_ratio": 2.0}],
    "scar": {"thickness_mm": 4.0, "stiffness_ratio": 3.0},
    "effects": {"viscoelastic": {"g": [0.2], "tau_s": [0.1]}, "activation-lag": {"tau_ms": 10.0}},
    "analysis": {"duration_ms": 2.0, "step_us": 50.0, "threads": 1},
    "record": {"every_ms": 1.0},
}
INDENTATION = {
    "title": "all keys",
    "model": {
        "name": "specimen",
        "radius_mm": 10.0,
        "height_mm": 5.0,
        "layer_mm": 0.5,
        "layer_stiffness_ratio": 2.0,
        "bonded_radius_mm": 8.0,
        "material": {"law": "mooney-rivlin", "C10_Pa": 100.0, "C01_Pa": 50.0},
        "gravity_m_s2": [0.0, 0.0, -9.81],
        "edge_size_mm": 0.8,
        "refinement": 1.0,
    },
    "tool": {"shape": "flat-cylinder", "radius_mm": 3.0, "edge_radius_mm": 0.8, "friction": 0.2},
    "effects": {"softening": {"inverse_r": 0.2, "m_Pa": 50.0, "beta": 0.1}, "fibres": {"k1_Pa": 100.0, "k2": 1.0}},
    "analysis": {"type": "relaxation", "forces_N": [0.01, 0.02], "times_s": [1.0, 2.0], "tolerance": 1e-3, "threads": 1},
}
VALUES = [1e-308, 1e308, -1e308, -1, 0, math.nan, math.inf, -math.inf, 1e15, 2**70, True, "text", [], [[1.0]] * 3, {}, None]


def leaves(value: object, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """The places of all numbers."""
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(inner, (*path, key))
    elif isinstance(value, int | float):
        yield path


def refusal(path: Path, read: Callable[..., object] = read_scenario, settings: Sequence[str] = ()) -> str | None:
    """The sentence with which a scenario is refused; None where it is read, or built."""
    begin = time.perf_counter()
    try:
        read(path, settings)
        return None
    except InputError as error:
        sentence = str(error)
    finally:
        assert time.perf_counter() - begin < LONGEST_ANSWER_S
    assert len(sentence) < LONGEST_SENTENCE_CHARACTERS, sentence[:1000]
    assert "\n" not in sentence and "valid are: ." not in sentence, sentence
    return sentence


@pytest.mark.parametrize("value", VALUES, ids=[json.dumps(value) for value in VALUES])
@pytest.mark.parametrize("scenario", [TRANSIENT, INDENTATION], ids=["transient", "indentation"])
def test_absurd_numbers(scenario: dict, value: object, tmp_path: Path) -> None:
    """Each number of each table in turn: what is far beyond any body is refused, with the key."""
    path = tmp_path / "absurd.json"
    for place in leaves(scenario):
        data = deepcopy(scenario)
        table = data
        for key in place[:-1]:
            table = table[key]
        table[place[-1]] = value
        path.write_text(json.dumps(data))
        sentence = refusal(path, read_scenario if value in (0, -1, None) else prepare)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not math.isfinite(value) or 0.0 < abs(value) < 1e-100 or abs(value) > 1e12:
            key = next(key for key in reversed(place) if isinstance(key, str))
            # null is for some keys as good as no key
            assert value is None or (sentence and key in sentence), (place, value, sentence)


@pytest.mark.parametrize("scenario", [TRANSIENT, INDENTATION], ids=["transient", "indentation"])
def test_the_scenarios_of_these_tests_can_be_built(scenario: dict, tmp_path: Path) -> None:
    path = tmp_path / "sound.json"
    path.write_text(json.dumps(scenario))
    assert prepare(path).describe()["hexes"] > 0


def test_every_number_of_a_scenario_has_bounds_in_the_schema() -> None:
    """Also those of laws and effects; and where it is bounded by its unit, the reason is said."""
    unbounded = []
    for table in json_schema()["$defs"].values():
        for key, part in table.get("properties", {}).items():
            for number in numbers_of(part):
                low, high = ({"minimum", "exclusiveMinimum"} & number.keys()), ({"maximum", "exclusiveMaximum"} & number.keys())
                reasoned = number.get("maximum") != bounds_of(key).largest or bounds_of(key).reason in part["description"]
                unbounded += [] if low and high and reasoned else [key]
    assert not unbounded
    assert all(bounds.smallest < bounds.largest for bounds in BOUNDS.values())


def numbers_of(part: object) -> Iterator[dict]:
    """The parts of a schema that are numbers."""
    if isinstance(part, list):
        for inner in part:
            yield from numbers_of(inner)
    elif isinstance(part, dict):
        if part.get("type") in ("number", "integer"):
            yield part
        for name in ("anyOf", "items", "prefixItems"):
            yield from numbers_of(part.get(name))


LONG = "x" * 6000
SETTINGS = {
    "nested lists": ("title=" + "[" * 1000 + "]" * 1000, "too many nested"),
    "nested tables": ("title=" + "{a=" * 1000 + "1" + "}" * 1000, "too many nested"),
    "levels that can be read": ("title=" + "[" * 60 + "]" * 60, "levels deep"),
    "many keys": (".".join("a" * 1000) + "=1", "is longer than"),
    "a value of 1e5 characters": ("title=" + "y" * 100_000, "is longer than"),
    "a long unknown key": (f"model.{LONG}=1", "too long"),
    "a long unknown table": (f"{LONG}=1", "too long"),
    "a long name": (f"muscle.{LONG}.force_N=1", "too long"),
    "a long muscle": (f"muscle.GGp.name={LONG}", "100 characters"),
    "a long list": (f"model.cells={[1] * 6000}", "three whole numbers"),
    "a title of many characters": ("title=" + "y" * 15_000, "300 characters"),
    "a title of two lines": ('title="one\\ntwo"', "one line"),
    "a control character": ('title="a\\u0000b"', "control character"),
    "a control character as it is": ("title=a\x1b[31mb", "control character"),
    "a control character in a key": ("title\x07=1", "title"),
    "a date": ("title=1979-05-27", "in quotes"),
    "a time": ("title=07:32:00", "in quotes"),
    "digits of other alphabets": ("muscle.².force_N=1", "no entry ²"),
    "a negative entry": ("muscle.-1.force_N=1", "no entry -1"),
    "an entry far behind": ("muscle.99999999999999999999.force_N=1", "no entry"),
    "a number of 5000 digits": ("analysis.threads=" + "9" * 5000, "cannot be read"),
    "more than 64 bits": ("analysis.threads=" + "9" * 30, "64 bits"),
    "cells of 400 digits": ("model.cells=[" + "9" * 400 + ",4,4]", "64 bits"),
    "two lines": ("title='a'\nquestion='b'", "more than one line"),
    "a key of a value": ("title.a=1", "title is a single value"),
    "a name of 150 characters": (f"muscle.{LONG[:150]}.force_N=1", "(150 characters)"),
    "the wrong law": ("model.material={law=[1]}", "law"),
    "text for a table": ("model=1", "must be a table"),
    "text for a list": ("bone=palate", "must be a list"),
    "a table for text": ("title={a=1}", "must be text"),
    "text for a switch": ("model.barrier=maybe", "true or false"),
    "too many samples": ("analysis.duration_ms=3.6e6", "1.8e+06 samples"),
    "a set twice": ('model.fixed=["jaw", "jaw"]', "twice"),
    "a force of a mountain": ("muscle.GGp.force_N=1e4", "1 kN"),
    "a modulus of diamond": ("model.material={C10_Pa=1e100, C20_Pa=0}", "model.material.C10_Pa = 1e+100"),
}


@pytest.mark.parametrize(("setting", "words"), SETTINGS.values(), ids=SETTINGS)
def test_absurd_settings(setting: str, words: str) -> None:
    sentence = refusal(VOWEL, settings=[setting])
    assert sentence and words in sentence, sentence


FILES = {
    "nested lists": (b"title = " + b"[" * 1000 + b"]" * 1000, "more than"),
    "a long key": (b"a" * 6000 + b" = 1", "a" * 60 + "..."),
    "a list of nothing": (b"title = 1\nmuscle = [" + b"0.0, " * 5000 + b"]", "more errors"),
    "empty": (b"", '"title" is missing'),
    "UTF-16": ('title = "a"'.encode("utf-16"), "UTF-8"),
    "half a character": (b'title = "\xe4"', "UTF-8"),
    "a NUL": (b'title = "\x00"', "not valid TOML"),
    "a date": (b"title = 1979-05-27", "put it in quotes"),
    "the end of nowhere": (b"title = ", "not valid TOML"),
    "a key twice": (b"title = 'a'\ntitle = 'b'", "not valid TOML"),
    "a number of 5000 digits": (b"title = " + b"9" * 5000, "not valid TOML"),
    "binary": (bytes(range(256)) * 10, "not"),
}


@pytest.mark.parametrize(("text", "words"), FILES.values(), ids=FILES)
def test_files_that_are_no_scenario(text: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "odd.toml"
    path.write_bytes(text)
    sentence = refusal(path)
    assert sentence and "odd.toml" in sentence and words in sentence, sentence


@pytest.mark.parametrize("mark", [b"\xef\xbb\xbf", b""], ids=["with a mark", "without"])
def test_texts_of_other_systems_are_read(mark: bytes, tmp_path: Path) -> None:
    path = tmp_path / "windows.toml"
    path.write_bytes(mark + VOWEL.read_bytes().replace(b"\n", b"\r\n"))
    assert refusal(path) is None


def test_what_is_no_file_of_a_scenario(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    with (tmp_path / "sparse.toml").open("wb") as file:
        file.truncate(10 * 2**30)
    for path, words in [
        (Path(os.devnull), "device"),
        (Path(os.devnull).parent / "zero", "device"),
        (tmp_path, "folder"),
        (tmp_path / "pipe.toml", "pipe"),
        (tmp_path / "sparse.toml", "10240 MiB"),
        (tmp_path / ("x" * 400), "cannot be read"),
        (tmp_path / "none.toml", "cannot be read"),
    ]:
        sentence = refusal(path)
        assert sentence and words in sentence, sentence


def test_settings_of_several_lines_stay_comments_in_the_stored_text() -> None:
    """What stands behind a line end must not become a key of the scenario that a result holds."""
    _, text = read_scenario(VOWEL, ["model.gravity_m_s2=[0,\n0,\n-9.81]"])
    assert text.startswith("# --set model.gravity_m_s2=[0, 0, -9.81]\n#:schema")


def test_the_number_of_problems_is_right(tmp_path: Path) -> None:
    path = tmp_path / "two.toml"
    path.write_text('title = 1\nquestion = 2\n[model]\nname = "tongue"\n[analysis]\nduration_ms = 1.0\n')
    assert "(1 more error: question)" in (refusal(path) or "")


# ---- sizes ----

BALL = ROOT / "scenarios" / "indentation-ball.toml"
THIN = "analysis.displacements_mm=[0.0001]"
SIZES = {
    "cells": (VOWEL, ["model.cells=[2000, 2000, 2000]"]),
    "cells of 64 bits": (VOWEL, ["model.cells=[4000000000, 4, 4]"]),
    "refinement": (BALL, ["model.refinement=100", "model.edge_size_mm=0.1"]),
    "edges of a micrometre": (BALL, ["model.edge_size_mm=0.001", "model.symmetry=whole"]),
    "a film": (BALL, ["model.radius_mm=10000", "model.height_mm=0.001", "model.edge_size_mm=0.001", THIN]),
    "a wire": (BALL, ["model.radius_mm=0.001", "model.height_mm=10000", "model.edge_size_mm=0.001"]),
    "a film that is a block": (BALL, ["model.size_mm=[10000, 10000, 0.001]", "model.symmetry=whole", THIN]),
}


@pytest.mark.parametrize(("scenario", "settings"), SIZES.values(), ids=SIZES)
def test_meshes_that_no_machine_holds_are_refused_before_they_are_built(scenario: Path, settings: list[str]) -> None:
    sentence = refusal(scenario, prepare, settings)
    assert sentence and "elements" in sentence, sentence


def test_memory_and_disk_are_asked_for_before_they_are_needed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(size, "available_bytes", lambda: 1e6)
    sentence = refusal(VOWEL, prepare, ["model.cells=[20, 10, 10]"])
    assert sentence and "2e+03 elements and need 10 MB of memory, but only 1 MB are free; use fewer cells" in sentence
    monkeypatch.undo()
    monkeypatch.setattr(outlook.shutil, "disk_usage", lambda folder: SimpleNamespace(free=1e3))
    for scenario, settings in [(VOWEL, ["model.cells=[8, 4, 4]"]), (BALL, [])]:
        with pytest.raises(MachineError, match=r"the result needs about .* MB, but only 0\.001 MB are free in .*; take"):
            run(scenario, tmp_path / "a" / "b", settings=settings)
    assert not list(tmp_path.iterdir())


def test_memory_of_a_control_group_counts(tmp_path: Path) -> None:
    """The smallest limit on the way up; "max" is none; files in its cache can be had."""
    membership = tmp_path / "membership"
    membership.write_text("0::/user/session\n")
    inner = tmp_path / "user" / "session"
    inner.mkdir(parents=True)
    for folder, most, used in [(inner, "max", 1), (inner.parent, "9000", 4000)]:
        (folder / "memory.max").write_text(f"{most}\n")
        (folder / "memory.current").write_text(f"{used}\n")
    (inner.parent / "memory.stat").write_text("anon 3000\ninactive_file 500\n")
    assert list(memory._of_groups(tmp_path, membership)) == [5500.0]
    assert list(memory._of_groups(tmp_path, tmp_path / "none")) == []
    assert 1e8 < memory.available_bytes() <= math.inf


# ---- runs without end ----


def test_runs_that_no_machine_ends_are_refused(tmp_path: Path) -> None:
    settings = ["model.cells=[8, 4, 4]", "analysis.duration_ms=3.6e6", "record.every_ms=1e4", "analysis.step_us=1e-6"]
    with pytest.raises(InputError, match=r"vowel-i.toml: the run would take 3.6e\+15 steps of 1e-06 microseconds"):
        run(VOWEL, tmp_path, settings=settings)
    assert not list(tmp_path.iterdir())


def test_runs_of_more_than_a_day_say_so_at_their_start(tmp_path: Path) -> None:
    settings = ["model.cells=[8, 4, 4]", "analysis.duration_ms=3.6e6", "record.every_ms=1e4", "analysis.step_us=0.01"]

    def stop(stage: str, share: float) -> None:
        if stage == "run" and stopping.asked() is None:
            signal.raise_signal(signal.SIGINT)

    with (
        pytest.warns(UserWarning, match=r"this run takes .* (days|years) \(3.6e\+11 steps of 0.01 microseconds\)"),
        stopping.watching(),
    ):
        summary = run(VOWEL, tmp_path, settings=settings, progress=stop)
    assert summary["status"] == "interrupted"
