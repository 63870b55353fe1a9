"""Whatever ends a command: one sentence on stderr, an exit code, with --json one object on stdout, and never a traceback."""

from __future__ import annotations

import errno
import json
import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pytest
from command import command
from support import ROOT

from explicitfe.app.cli.app import COMMANDS, GROUPS
from explicitfe.app.cli.ending import LONGEST_MESSAGE_CHARACTERS
from explicitfe.app.tools import lists
from explicitfe.platform.errors import InputError, MachineError, RunError
from explicitfe.platform.host import stopping
from explicitfe.simulate.run import transient

NAMES = [[name] for panel in COMMANDS.values() for name in panel]
NAMES += [[group, name] for panel in GROUPS.values() for group, (_, commands) in panel.items() for name in commands]
SMALL = ["--set", "model.cells=[8,4,4]", "--set", "analysis.duration_ms=2"]


def raising(error: BaseException) -> Callable[[], list[lists.Row]]:
    def rows() -> list[lists.Row]:
        raise error

    return rows


def signalled() -> list[lists.Row]:
    """A signal comes while a command works; what it calls next notices."""
    signal.raise_signal(signal.SIGTERM)
    stopping.check()
    return []


# what happens inside a command -> kind, exit code, words of the sentence
ENDS = {
    "input": (raising(InputError("no such thing.")), "input", 2, "error: no such thing."),
    "simulation": (raising(RunError("it does not converge.")), "simulation", 3, "failed: it does not converge."),
    "machine": (raising(MachineError("the disk is full.")), "machine", 3, "failed: the disk is full."),
    "memory": (raising(MemoryError()), "machine", 3, "not enough memory"),
    "no permission": (
        raising(PermissionError(errno.EACCES, "Permission denied", "secret")),
        "machine",
        3,
        "secret: .*Permission",
    ),
    "disk full": (raising(OSError(errno.ENOSPC, "No space left on device")), "machine", 3, "No space left"),
    "killed worker": (raising(BrokenProcessPool("a child died")), "machine", 3, "was killed"),
    "fault": (
        raising(ValueError("summary has\n487948 bytes")),
        "fault",
        3,
        r"internal error of explicitfe.*summary has 487948 bytes",
    ),
    "recursion": (raising(RecursionError("too deep")), "fault", 3, "internal error of explicitfe.*too deep"),
    "pipe": (raising(BrokenPipeError(errno.EPIPE, "Broken pipe")), "fault", 3, "internal error of explicitfe.*Broken pipe"),
    "missing file": (
        raising(FileNotFoundError(errno.ENOENT, "No such file", "a.toml")),
        "fault",
        3,
        "internal error of explicitfe",
    ),
    "assertion": (raising(AssertionError()), "fault", 3, r"internal error of explicitfe \(AssertionError\)"),
    "Ctrl-C": (raising(KeyboardInterrupt()), "stopped", 130, "ended: interrupted by Ctrl-C; no incomplete file was left"),
    "SIGTERM": (signalled, "stopped", 143, "interrupted by SIGTERM; no incomplete file was left"),
}


@pytest.mark.parametrize("name", ENDS)
def test_what_ends_a_command(name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    happens, kind, code, words = ENDS[name]
    monkeypatch.setitem(lists.LISTS, "models", happens)
    assert command(["list", "models"]) == code
    plain = capsys.readouterr()
    assert plain.out == "" and "Traceback" not in plain.err
    sentence = plain.err.splitlines()[-1]
    assert re.search(words, sentence), sentence

    assert command(["list", "models", "--json"]) == code
    shown = capsys.readouterr()
    assert shown.err.splitlines()[-1] == sentence
    message = sentence.partition(": ")[2]
    assert json.loads(shown.out) == {"failure": {"kind": kind, "message": message, "exit_code": code}}


@pytest.mark.parametrize("debug", ["--debug at the end", "--debug first", "environment"])
def test_debug_shows_where_an_error_comes_from(
    debug: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(lists.LISTS, "models", raising(ValueError("odd")))
    words = ["list", "models"]
    if debug == "environment":
        monkeypatch.setenv("EXPLICITFE_DEBUG", "1")
    else:
        words = ["--debug", *words] if debug == "--debug first" else [*words, "--debug"]
    assert command(words) == 3
    shown = capsys.readouterr().err
    assert "Traceback" in shown and "in rows" in shown and "fault: internal error of explicitfe (ValueError: odd)" in shown


def test_a_fault_names_the_file_that_was_worked_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = tmp_path / "mine.toml"
    scenario.write_bytes((ROOT / "scenarios/vowel-i.toml").read_bytes())
    monkeypatch.setattr(transient, "assemble", lambda *given: 1 / 0)
    assert command(["check", str(scenario), "--set", "title='a'"]) == 3
    sentence = capsys.readouterr().err.strip()
    assert f"internal error of explicitfe while working on {scenario} (ZeroDivisionError: division by zero)" in sentence
    assert "Please report this error with the file" in sentence and "--debug" in sentence


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["lisst"], "No such command 'lisst'"),
        (["run"], "Missing argument"),
        (["run", "a.toml", "--frobnicate"], "No such option: --frobnicate"),
        (["run", "a.toml", "b.toml"], "Got unexpected extra argument"),
        (["run", "a.toml", "--set"], "'--set' requires an argument"),
        (["new"], "Missing command; see `explicitfe new --help`"),
        (["sweep", "x", "--seed", "a"], "Invalid value for '--seed'"),
        (["--frobnicate", "list"], "No such option: --frobnicate"),
    ],
)
def test_wrong_use_is_one_sentence(words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    for json_option in ([], ["--json"]):
        assert command([*words[:1], *json_option, *words[1:]]) == 2
        shown = capsys.readouterr()
        (line,) = shown.err.splitlines()
        assert line.startswith("error: ") and re.search(r"see `explicitfe.* --help`\.$", line)
        if json_option:
            assert json.loads(shown.out)["failure"] == {
                "kind": "input",
                "message": line.removeprefix("error: "),
                "exit_code": 2,
            }
        else:
            assert shown.out == "" and sentence in line


def test_an_echo_is_short_and_harmless(capsys: pytest.CaptureFixture[str]) -> None:
    """Of a name of 6000 characters, of one that would write to the title of the terminal, of bytes that are no text."""
    for name in ("a" * 6000, "\x1b]0;owned\x07\x9b31m", "\udcff", "[red]", "[/]"):
        assert command(["list", name]) == 2
        shown = capsys.readouterr().err
        assert len(shown) < LONGEST_MESSAGE_CHARACTERS + 20 and shown.startswith("error: cannot list")
        assert not any(code in shown for code in "\x1b\x07\x9b")
    assert "[/]" in shown


def test_help_says_how_and_with_what_exit_code(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    assert command([]) == 0
    root = " ".join(capsys.readouterr().out.split())
    assert "Exit codes: 0 done, 2 invalid input, 3 stopped early" in root and root.count("explicitfe ") >= 3
    monkeypatch.setenv("COLUMNS", "80")
    for words in NAMES:
        assert command([*words, "--help"]) == 0
        shown = capsys.readouterr().out
        assert "\u2026" not in shown, words  # no name of an option is cut
        text = " ".join(shown.split())
        assert re.search(f"Examples?: explicitfe {' '.join(words)}", text), words


def test_a_run_whose_pictures_cannot_be_drawn_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The result stands, the summary says so and how to draw it."""
    from explicitfe.app.view import draw

    monkeypatch.setitem(draw.PICTURES, "transient", {"contour": lambda *given: 1 / 0})
    words = ["run", str(ROOT / "scenarios/vowel-i.toml"), "--out", str(tmp_path), "--plots", "--json", *SMALL]
    assert command(words) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["status"] == "finished" and "failure" not in summary and "plots" not in summary
    (warning,) = [text for text in summary["warnings"] if "could not be drawn" in text]
    assert "ZeroDivisionError" in warning and "the result is complete" in warning
    monkeypatch.undo()
    again = shlex.split(warning.partition("draw it with 'explicitfe ")[2].removesuffix("'."))
    assert command([*again, "--only", "contour", "--json"]) == 0
    (picture,) = json.loads(capsys.readouterr().out)["files"]
    assert Path(picture).parent == tmp_path and Path(picture).name == "vowel-i-contour.png"


def test_a_signal_while_pictures_are_drawn_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from explicitfe.app.view import draw

    def stop(*given: object) -> None:
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setitem(draw.PICTURES, "transient", {"contour": stop})
    words = ["run", str(ROOT / "scenarios/vowel-i.toml"), "--out", str(tmp_path), "--plots", "--json", *SMALL]
    assert command(words) == 130
    summary = json.loads(capsys.readouterr().out)
    assert summary["status"] == "finished" and summary["failure"]["kind"] == "stopped"
    assert "while drawing: the result is complete" in summary["failure"]["message"]


def explicitfe(*words: str, **streams: object) -> subprocess.Popen[bytes]:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.Popen([sys.executable, "-m", "explicitfe", *words], env=environment, **streams)  # type: ignore[call-overload]


@pytest.mark.skipif(os.name == "nt", reason="pipes that break are a thing of Unix")
@pytest.mark.parametrize("words", [["list", "muscles"], ["list", "muscles", "--json"], ["--help"]], ids=" ".join)
def test_a_reader_that_leaves_is_no_fault(words: list[str]) -> None:
    """As in ``explicitfe list muscles | head -1``."""
    read, write = os.pipe()
    os.close(read)
    process = explicitfe(*words, stdout=write, stderr=subprocess.PIPE)
    os.close(write)
    error = process.communicate()[1]
    assert process.returncode == 0 and error == b""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full, a disk that is always full")
def test_a_full_disk_under_an_answer() -> None:
    """An answer that could not be written is told; words that could not are dropped, and nothing fails for them."""
    with Path("/dev/full").open("w") as full:
        process = explicitfe("list", "muscles", "--json", stdout=full, stderr=subprocess.PIPE)
        error = process.communicate()[1].decode()
        assert process.returncode == 3
        assert error.strip() == "failed: the answer could not be written to stdout: No space left on device."
        process = explicitfe("list", "nothing", stdout=subprocess.PIPE, stderr=full)
        assert process.communicate()[0] == b"" and process.returncode == 2


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="needs /proc")
def test_closed_streams_are_opened_on_nothing() -> None:
    """Else a result file could get the number of stderr, and messages of libraries would go into it."""
    code = "import os, sys; sys.argv = ['explicitfe', '--version']; from explicitfe.app.cli.main import main\nmain()\n"
    code += "os.write(1, os.readlink('/proc/self/fd/2').encode())"
    words = ["sh", "-c", 'exec "$0" -c "$1" 2>&- <&-', sys.executable, code]
    done = subprocess.run(words, stdout=subprocess.PIPE, env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert done.returncode == 0 and done.stdout.split()[-1] == b"/dev/null"


@pytest.mark.skipif(os.name == "nt", reason="Windows deletes no folder that is in use")
def test_a_deleted_working_folder_is_one_sentence(tmp_path: Path) -> None:
    code = f"cd {shlex.quote(str(tmp_path))} && mkdir gone && cd gone && rmdir ../gone && "
    words = shlex.join([sys.executable, "-m", "explicitfe", "run", "vowel-i", *SMALL])
    done = subprocess.run(["sh", "-c", code + words], capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert done.returncode == 3
    assert done.stderr.splitlines()[-1] == "failed: the current folder has been deleted; change to an existing folder (cd)."


@pytest.mark.parametrize(
    ("variable", "value", "words"),
    [
        ("NUMBA_DISABLE_JIT", "1", "NUMBA_DISABLE_JIT is set, but explicitfe needs Numba's compiler; unset"),
        ("NUMBA_NUM_THREADS", "0", 'NUMBA_NUM_THREADS is "0", but must be a number of threads'),
        ("NUMBA_NUM_THREADS", "many", 'NUMBA_NUM_THREADS is "many", but must be a number of threads'),
        ("EXPLICITFE_CORES", "x", 'EXPLICITFE_CORES is "x", but must be a number of cores'),
        ("EXPLICITFE_CORES", "-2", 'EXPLICITFE_CORES is "-2", but must be a number of cores'),
    ],
)
def test_a_wrong_environment_variable_is_one_sentence(
    variable: str, value: str, words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(variable, value)
    assert command(["check", "vowel-i", *SMALL]) == 2
    assert words in capsys.readouterr().err.splitlines()[-1]


def test_letters_that_turn_the_direction_of_text_are_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A title with U+202E would show the rest of a line reversed, so that a report seems to say something else."""
    scenario = tmp_path / "turned.toml"
    text = (ROOT / "scenarios/vowel-i.toml").read_text(encoding="utf-8")
    scenario.write_text(text.replace("Vowel [i]", "Vowel \u202e[i]\u2066"), encoding="utf-8")
    assert command(["check", str(scenario), *SMALL]) == 2
    shown = capsys.readouterr().err
    assert "'\\u202e'" in shown and "\u202e" not in shown
