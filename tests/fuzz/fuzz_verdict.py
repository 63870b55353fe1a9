"""What is held of every input: a sentence and an exit code, in time, and nothing left outside the folder of the output."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

from command import command
from fuzz_inputs import FuzzInput
from numba.core import event

LIMIT_S = 20.0  # for one input, of a processor that works for nobody else, besides the making of machine code
WAITING_LIMIT_S = 120.0  # for one input on a busy machine
CHILD_LIMIT_S = 40.0  # the same with the start of a process, on a busy machine
COMPILE_LIMIT_S = 400.0  # for a process that may have to make machine code: then it is tried once more
LARGEST_BALANCE_ERROR = 1e-3
LONGEST_SENTENCE = 1100  # with "error: " and what says that it was cut
EXIT_CODES = {0, 1, 2, 3}
REFUSED = 2
# What explicitfe calls a fault of its own, on stderr: no input should come to it.
OWN_FAULT = "internal error of explicitfe"
# Places of the machine that anybody's program writes to: caches of machine code and of fonts, the null device.
COMMON_PLACES = ("__pycache__", "matplotlib", "fontconfig", "/dev/null", "numba")


class TooLong(BaseException):
    """The time for one input has passed."""


@dataclass
class Verdict:
    """What became of an input.

    Attributes
    ----------
    code : exit code; None where the command raised.
    ran : whether a result, or an answer in a folder, was left.
    faults : promises that were broken, with what is needed to see why.
    """

    kind: str
    code: int | None = None
    seconds: float = 0.0
    ran: bool = False
    faults: list[str] = field(default_factory=list)


def judged(given: FuzzInput, folder: Path, *, in_child: bool = False) -> Verdict:
    """Put the files into a new folder, call the command there, and see what it did.

    Parameters
    ----------
    folder : an empty one; ``work`` and ``tmp`` appear in it.
    in_child : call it as a shell would, in a process of its own, which sees what compiled libraries print or how they die.
    """
    folder = folder.resolve()
    work, scratch = folder / "work", folder / "tmp"
    for place in (work, scratch):
        place.mkdir()
    for name, raw in given.files.items():
        (work / name).write_bytes(raw)
    before = contents(work)
    verdict = Verdict(given.kind)
    words, told = (_call_in_child if in_child else _call)(given, work, scratch, verdict)
    verdict.faults += words_broken(verdict.code, words, told, "--json" in given.arguments)
    after = contents(work)
    verdict.faults += [f"outside: {name}" for name in _changed(before, after) if not name.startswith(("out", "outputs"))]
    verdict.faults += [f"left behind: {name}" for name in contents(scratch)]
    if verdict.code == REFUSED:
        verdict.faults += [f"left by a refused command: {name}" for name in _changed(before, after)]
    for path in sorted(work.rglob("*.vtkhdf")):
        if path.name in given.files:
            continue
        _judge_result(path, verdict)
    for name in ("predict.json", "identify.json", "report.json", "score.json", "made.json"):
        for path in work.rglob(name):
            _judge_document(path, work, verdict)
    return verdict


def _call(given: FuzzInput, work: Path, scratch: Path, verdict: Verdict) -> tuple[str, str]:
    """Call the command in this process; what it printed on stdout and on stderr."""
    output, errors = io.BytesIO(), io.BytesIO()
    with (
        _in_folder(work, scratch),
        _captured(output, errors),
        _watched_writing(work.parent) as outside,
        _compile_timer() as compiling,
    ):
        begin, begin_cpu = time.perf_counter(), time.process_time()

        def taken() -> float:
            """Seconds of work, or of the clock where it waits too long, besides those for machine code."""
            waited = time.perf_counter() - begin - compiling()
            return waited if waited > WAITING_LIMIT_S else min(time.process_time() - begin_cpu, waited)

        try:
            with _time_limit(taken):
                verdict.code = command(list(given.arguments))
        except TooLong:
            verdict.faults.append(f"longer than {LIMIT_S:g} s: {_innermost(sys.exc_info()[2])}")
        except BaseException as error:
            verdict.faults.append(f"traceback: {type(error).__name__} at {_innermost(error.__traceback__)}: {str(error)[:200]}")
        verdict.seconds = taken()
    verdict.faults += [f"outside: {path}" for path in sorted(outside)]
    return output.getvalue().decode("utf-8", "replace"), errors.getvalue().decode("utf-8", "replace")


def _call_in_child(given: FuzzInput, work: Path, scratch: Path, verdict: Verdict) -> tuple[str, str]:
    """Call the command as a shell would; what it printed on stdout and on stderr."""
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2]), "TMPDIR": str(scratch)}
    call = [sys.executable, "-m", "explicitfe", *given.arguments]
    for limit_s in (COMPILE_LIMIT_S, CHILD_LIMIT_S):
        begin = time.perf_counter()
        try:
            ended = subprocess.run(call, cwd=work, env=environment, capture_output=True, timeout=limit_s, check=False)
        except subprocess.TimeoutExpired:
            verdict.faults.append(f"longer than {limit_s:g} s in a process of its own")
            return "", "stopped by the harness"
        verdict.seconds = time.perf_counter() - begin
        if verdict.seconds < CHILD_LIMIT_S:
            break
        for name in ("out", "outputs"):  # It was slow; now it has its machine code.
            shutil.rmtree(work / name, ignore_errors=True)
    verdict.code = ended.returncode
    return ended.stdout.decode("utf-8", "replace"), ended.stderr.decode("utf-8", "replace")


def words_broken(code: int | None, words: str, told: str, as_json: bool) -> list[str]:
    """Which promises about words a command broke by what it printed on stdout and on stderr."""
    broken = []
    for text in (words, told):
        if "Traceback (most recent call last)" in text:
            broken.append(f"traceback: {text.strip().splitlines()[-1][:200]}")
        if OWN_FAULT in text:
            broken.append(f"own fault: {' '.join(text.split())[:300]}")
    if code is not None and code not in EXIT_CODES:
        broken.append(f"exit code {code}")
    if code and not told.strip() and not words.strip():
        broken.append(f"exit code {code} without a word")
    if code == REFUSED and max(map(len, told.splitlines()), default=0) > LONGEST_SENTENCE:
        broken.append(f"a sentence of {len(told)} characters: {told[:100]}")
    if "\x1b[" in told.replace("\x1b[2K", "").replace("\x1b[1A", "") and not sys.stderr.isatty():
        broken.append(f"control characters: {told[:100]!r}")
    if as_json and code == 0:
        try:
            json.loads(words)
        except ValueError as error:
            broken.append(f"no JSON on stdout: {error}")
    return broken


def _judge_result(path: Path, verdict: Verdict) -> None:
    """A result that is there is whole, says how it ended, and notes a balance of energies that is not closed."""
    from explicitfe.results.files import open_result

    try:
        with open_result(path) as result:
            held = result.contents()
    except BaseException as error:
        verdict.faults.append(f"half-written: {path.name}: {type(error).__name__}: {error}")
        return
    status, summary = held["status"], held["summary"]
    verdict.ran = True
    if status == "finished" and verdict.code != 0:
        verdict.faults.append(f"half-written: {path.name} is finished, exit code {verdict.code}")
    if verdict.code == 0 and (status != "finished" or path.name.endswith(".running.vtkhdf")):
        verdict.faults.append(f"half-written: {path.name} is {status}, exit code 0")
    error = summary.get("energy_balance_error")
    if status == "finished" and not summary.get("warnings") and (error is None or not abs(error) < LARGEST_BALANCE_ERROR):
        verdict.faults.append(f"balance of {error} without a note")


def _judge_document(path: Path, work: Path, verdict: Verdict) -> None:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        verdict.faults.append(f"half-written: {path.name}: {error}")
        return
    verdict.ran = True
    missing = [name for name in document.get("files") or () if not (work / name).is_file()]
    verdict.faults += [f"half-written: {path.name} names {name}, which is not there" for name in missing]


def contents(folder: Path) -> dict[str, str]:
    """Everything below a folder, with a sum of its bytes."""
    names = {}
    for path in sorted(folder.rglob("*")):
        what = "folder" if path.is_dir() else hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "special"
        names[path.relative_to(folder).as_posix()] = what
    return names


def _changed(before: dict[str, str], after: dict[str, str]) -> list[str]:
    return sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))


# ---- around a call ----


@contextlib.contextmanager
def _in_folder(work: Path, scratch: Path) -> Iterator[None]:
    import tempfile

    # Where a command would end its process (a second signal) or wait for a terminal, the harness could not go on.
    before, old_scratch = Path.cwd(), tempfile.tempdir
    os.chdir(work)
    tempfile.tempdir = str(scratch)
    try:
        yield
    finally:
        tempfile.tempdir = old_scratch
        os.chdir(before)


@contextlib.contextmanager
def _captured(output: io.BytesIO, errors: io.BytesIO) -> Iterator[None]:
    """Words as bytes of UTF-8, refused where they cannot be, as on a terminal."""
    out = io.TextIOWrapper(output, encoding="utf-8", errors="strict", write_through=True)
    err = io.TextIOWrapper(errors, encoding="utf-8", errors="backslashreplace", write_through=True)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        yield
    out.detach()
    err.detach()


class _Compiling(event.Listener):
    """Seconds spent on machine code so far: that is made once on a machine, and says nothing about an input."""

    def __init__(self) -> None:
        self._spent, self._since, self._depth = 0.0, 0.0, 0

    def on_start(self, event: object) -> None:
        if self._depth == 0:
            self._since = time.perf_counter()
        self._depth += 1

    def on_end(self, event: object) -> None:
        self._depth -= 1
        if self._depth == 0:
            self._spent += time.perf_counter() - self._since

    def seconds(self) -> float:
        return self._spent + (time.perf_counter() - self._since if self._depth else 0.0)


@contextlib.contextmanager
def _compile_timer() -> Iterator[Callable[[], float]]:
    watch = _Compiling()
    event.register("numba:compile", watch)
    try:
        yield watch.seconds
    finally:
        event.unregister("numba:compile", watch)


@contextlib.contextmanager
def _time_limit(taken: Callable[[], float]) -> Iterator[None]:
    """Raise TooLong in the main thread once the limit has passed; where compiled code runs, once it returns."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def look(number: int, frame: FrameType | None) -> None:
        signal.alarm(2)  # Once more, where somebody swallows it.
        if taken() > LIMIT_S:
            raise TooLong

    old = signal.signal(signal.SIGALRM, look)
    signal.alarm(int(LIMIT_S))
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, old)


class _Writing:
    """Python's audit hook cannot be taken out again: one stays, and reports to whom is listening."""

    installed = False
    allowed: str | None = None
    outside: set[str]


def _note_writing(name: str, arguments: tuple[object, ...]) -> None:
    if _Writing.allowed is None:
        return
    if name == "open":
        path, _, flags = arguments
        writes = isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND)
        # A folder is opened for a file without a name, which tries whether it can be written and leaves nothing.
        targets = [path] if writes and not (isinstance(path, str) and Path(path).is_dir()) else []
    elif name in ("os.mkdir", "os.remove", "os.rmdir", "os.truncate", "os.chmod"):
        targets = [arguments[0]]
    elif name in ("os.rename", "os.link", "os.symlink"):
        targets = list(arguments[:2])
    else:
        return
    for target in targets:
        if not isinstance(target, str | bytes | os.PathLike):
            continue
        path = str(Path.cwd() / os.fsdecode(target))
        if not path.startswith(_Writing.allowed) and not any(place in path.lower() for place in COMMON_PLACES):
            _Writing.outside.add(path)


@contextlib.contextmanager
def _watched_writing(folder: Path) -> Iterator[set[str]]:
    """Paths outside the folder that something was written to, made, moved or removed."""
    if not _Writing.installed:
        sys.addaudithook(_note_writing)
        _Writing.installed = True
    _Writing.outside = set()
    _Writing.allowed = str(folder.resolve()) + os.sep
    try:
        yield _Writing.outside
    finally:
        _Writing.allowed = None


def _innermost(trace: object) -> str:
    """File and line of the package's innermost frame."""
    frames = [frame for frame in traceback.extract_tb(trace) if f"{os.sep}explicitfe{os.sep}" in frame.filename]  # type: ignore[arg-type]
    if not frames:
        frames = traceback.extract_tb(trace)[-1:]  # type: ignore[arg-type]
    return " < ".join(f"{Path(frame.filename).name}:{frame.name}" for frame in frames[:-4:-1])
