"""Many processes at work in one folder, for one result: runs, killed runs, links, foreign files, files without permission.

Each run has a number of its own in all it stores, so that a file of two runs is known; each process sees that what it has put
into the folder stays as it is.
"""

from __future__ import annotations

import os
import pickle
import stat
import time
from collections import Counter
from pathlib import Path

import h5py
import numpy as np
from tiny_result import MESH, displacement, jacobian, start

from explicitfe.platform.errors import InputError, RunError
from explicitfe.platform.host import files
from explicitfe.results.files import FINISHED, ResultWriter, open_result

SAMPLES = 3
PLANTS = ("text", "empty", "HDF5", "link", "dangling link", "folder", "pipe", "read-only result")
KINDS = ("run", "run over", "refused run", "killed run", "go on", "take away", *PLANTS)


class ViolationError(Exception):
    """Something of somebody else was touched."""


def abuse(folder: Path, attempts: int, at_once: int, seed: int) -> Counter[tuple[str, str]]:
    """How often each kind of attempt ended how: "finished", "killed", "kept", or the beginning of a sentence.

    Parameters
    ----------
    folder : empty.
    at_once : processes that are at work at a time.
    """
    rng = np.random.default_rng(seed)
    place, logs = folder / "shared", folder / "logs"
    place.mkdir()
    logs.mkdir()
    victim = folder / "victim.vtkhdf"
    victim.write_bytes(b"of somebody else")
    children: dict[int, tuple[int, str]] = {}
    counts: Counter[tuple[str, str]] = Counter()
    for number in range(attempts):
        kind = str(rng.choice(KINDS, p=_shares()))
        child = os.fork()
        if child == 0:
            _child(number, kind, place, victim, logs, int(rng.integers(2**31)))
        children[child] = number, kind
        while len(children) >= at_once or (children and number == attempts - 1):
            child, _ = os.wait()
            number_of_child, kind_of_child = children.pop(child)
            log = logs / str(number_of_child)
            answer = pickle.loads(log.read_bytes()) if log.exists() else "killed"
            assert answer != "killed" or kind_of_child == "killed run", f"{kind_of_child} ended without a word"
            assert not isinstance(answer, Exception), f"{kind_of_child}: {answer!r}"
            counts[kind_of_child, answer] += 1
    assert victim.read_bytes() == b"of somebody else"
    whole = [path for path in place.iterdir() if path.suffix == ".vtkhdf"]
    for path in whole:
        identity_of(path)
    assert not {path.name for path in whole} - {"a.vtkhdf", "a.running.vtkhdf"}
    return counts


def identity_of(path: Path) -> int:
    """The number of the run that a result is of, and of it alone."""
    with open_result(path) as result:
        identity = int(result.provenance["explicitfe"])
        for step in range(len(result.times)):
            np.testing.assert_array_equal(result.displacement(step), displacement(step) + identity)
        np.testing.assert_array_equal(result.history("kinetic_energy"), np.full(len(result.times), identity))
        return identity


def _shares() -> np.ndarray:
    runs = len(KINDS) - len(PLANTS)
    return np.array([0.7 / runs] * runs + [0.3 / len(PLANTS)] * len(PLANTS))


def _child(number: int, kind: str, place: Path, victim: Path, logs: Path, seed: int) -> None:
    """Make an attempt, note how it ended, and leave."""
    answer: str | Exception
    try:
        answer = _plant(kind, place, victim, np.random.default_rng(seed)) if kind in PLANTS else _run(kind, number, place)
    except (InputError, RunError) as error:
        sentence = str(error)
        assert "\n" not in sentence
        answer = " ".join(word for word in sentence.split() if "/" not in word and not word.isdigit())
    except BaseException as error:
        import traceback

        answer = ViolationError("".join(traceback.format_exception(error))[-2000:])
    (logs / f"{number}.part").write_bytes(pickle.dumps(answer))
    (logs / f"{number}.part").rename(logs / str(number))
    os._exit(0)


def _take_away(place: Path, number: int) -> str:
    """What a user does with a result that is done."""
    path, target = place / "a.vtkhdf", place.parent / f"{number}.vtkhdf"
    try:
        file = files.open_plain(path)
        if not files.lock(file) or not files.is_at(path, file):
            return "somebody goes on with it"
    except OSError:
        return "nothing to take"
    try:
        identity_of(path)
    except InputError:
        return "no result"
    path.rename(target)
    identity_of(target)
    return "taken"


def _run(kind: str, number: int, place: Path) -> str:
    if kind == "take away":
        return _take_away(place, number)
    if kind == "go on":
        left = next((path for path in (place / "a.running.vtkhdf", place / "a.vtkhdf") if path.exists()), None)
        if left is None:
            return "nothing to go on with"
        identity = identity_of(left)
        run = ResultWriter.reopen(left)
    else:
        identity = number
        run = start(place / "a.vtkhdf", overwrite=kind == "run over", provenance={"explicitfe": str(number)}, mesh=MESH)
    with run:
        if kind == "refused run":
            return "finished"
        for step in range(SAMPLES):
            u = displacement(step) + identity
            row = {"kinetic_energy": identity, "probe_tip_displacement": u[11]}
            cells = {"J": jacobian(step), "hourglass_energy": jacobian(step)}
            run.sample(1e-3 * step, row, {"displacement": u, "velocity": u}, cells)
            if kind == "killed run" and step == 1:
                os._exit(9)
        run.finish(FINISHED, "", {})
    return "finished"


def _plant(kind: str, place: Path, victim: Path, rng: np.random.Generator) -> str:
    """Put something where a run wants to write, see that it stays for a while, and take it away."""
    path = place / str(rng.choice(["a.vtkhdf", "a.running.vtkhdf"]))
    source = place.parent / f"{os.getpid()}.planted"
    if kind.endswith("link"):
        source.symlink_to(victim if kind == "link" else victim.with_name("nowhere.vtkhdf"))
    elif kind == "folder":
        source.mkdir()
    elif kind == "pipe":
        os.mkfifo(source)
    elif kind == "HDF5":
        with h5py.File(source, "w") as file:
            file["x"] = 1
    else:
        source.write_bytes(b"" if kind == "empty" else b"mine")
        source.chmod(stat.S_IRUSR if kind == "read-only result" else 0o600)
    planted = source.lstat()
    content = source.read_bytes() if stat.S_ISREG(planted.st_mode) else b""
    try:
        files.rename_new(source, path)
    except OSError:
        if source.is_dir():
            source.rmdir()
        else:
            source.unlink()
        return "the name was taken"
    time.sleep(0.05)
    if not os.path.samestat(path.lstat(), planted) or (content and path.read_bytes() != content):
        raise ViolationError(f"{kind} at {path.name} was touched")
    if kind == "folder":
        path.rmdir()
    else:
        path.unlink()
    return "kept"
