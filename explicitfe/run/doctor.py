"""``explicitfe doctor``: what an installation and its machine can do, and what will be noticed."""

from __future__ import annotations

import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from explicitfe.compiled.threads import cores
from explicitfe.errors import Progress, silent
from explicitfe.host.code_cache import VARIABLE
from explicitfe.host.extras import PACKAGES, has_extra, how_to_install
from explicitfe.host.load import is_busy, load
from explicitfe.host.memory import available_bytes, in_words
from explicitfe.results.examination import Examination, Finding, State
from explicitfe.results.provenance import provenance
from explicitfe.view.opengl import tried_renderer

LIBRARIES = ("numpy", "numba", "scipy", "h5py", "meshio", "pydantic", "typer")
# What an extra is for.
USES = {
    "view": "3D, GIF and MP4",
    "plots": "pictures as PNG, PDF, SVG",
    "parquet": "export to Parquet",
    "sensitivity": "Sobol and Morris designs of a sweep",
    "cluster": "a sweep on a Dask cluster",
}
# A run of the finest tongue needs less memory, and its result less room.
SMALLEST_MEMORY_BYTES = 2e9
SMALLEST_ROOM_BYTES = 1e9
# A picture that takes longer is drawn by the processor, which is slow and right.
FAST_RENDERER_S = 10.0


def examine(folder: Path | str = ".", progress: Progress = silent) -> Examination:
    """Look at the versions, the machine, the folder for results, the machine code that is kept, and whether 3D can be drawn.

    Parameters
    ----------
    folder : where results would go.
    progress : called with the stage and the share of it that is done.
    """
    progress("draw", 0.0)
    findings = [*_program(), *_machine(), *_places(Path(folder)), *_extras(), _drawing()]
    progress("draw", 1.0)
    return {"findings": findings, "attention": sum(one["state"] == "attention" for one in findings)}


def _finding(name: str, value: str, state: State = "good", advice: str = "") -> Finding:
    return {"name": name, "state": state, "value": value, "advice": advice}


def _program() -> Iterator[Finding]:
    where = provenance()
    commit = f", commit {where['commit']}" if where["commit"] else ""
    yield _finding("explicitfe", f"{where['explicitfe'] or 'not installed'}{commit}, in {Path(__file__).resolve().parents[1]}")
    yield _finding("python", f"{where['python']}, {sys.executable}")
    yield _finding("libraries", ", ".join(f"{name} {_version(name)}" for name in LIBRARIES))


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "missing"


def _machine() -> Iterator[Finding]:
    where = provenance()
    yield _finding("system", f"{where['platform']}, {where['processor']}")
    usable, present = cores(), os.cpu_count() or 1
    stated = " (EXPLICITFE_CORES)" if os.environ.get("EXPLICITFE_CORES") else ""
    yield _finding("cores", f"{usable} of {present} may be used{stated}")
    processes = load()
    if processes is not None:
        advice = "the machine is busy: runs take longer, and times of `explicitfe bench` say nothing; wait until it is idle."
        yield _finding("load", f"{processes:.2f} in the last minute", *(("attention", advice) if is_busy(processes) else ()))
    memory = available_bytes()
    little = memory < SMALLEST_MEMORY_BYTES
    advice = "close other programs before you run a fine mesh."
    yield _finding("memory", f"{in_words(memory)} are free", *(("attention", advice) if little else ()))
    encoding = getattr(sys.stdout, "encoding", None) or "unknown"
    if encoding.lower().replace("-", "") != "utf8":
        advice = "letters such as ² and χ are written as escapes; set PYTHONUTF8=1."
        yield _finding("terminal", f"encoding {encoding}", "attention", advice)


def _places(folder: Path) -> Iterator[Finding]:
    room = shutil.disk_usage(folder).free
    if not _can_write(folder):
        yield _finding("results", f"{folder.resolve()} cannot be written", "attention", "give another folder with --out.")
    elif room < SMALLEST_ROOM_BYTES:
        advice = "results may not fit; give a folder on another disk with --out."
        yield _finding("results", f"{in_words(room)} are free in {folder.resolve()}", "attention", advice)
    else:
        yield _finding("results", f"{in_words(room)} are free in {folder.resolve()}")
    kept, size = _kept_code()
    if kept is None:
        advice = f"machine code is compiled anew for each run, about a minute; name a folder that you can write by {VARIABLE}."
        yield _finding("machine code", "no folder can be written", "attention", advice)
    elif not size:
        yield _finding(
            "machine code", f"none is kept yet in {kept}", "absent", "`explicitfe warmup` compiles it now, in a minute."
        )
    else:
        yield _finding("machine code", f"{in_words(size)} are kept in {kept}")


def _can_write(folder: Path) -> bool:
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _kept_code() -> tuple[Path | None, int]:
    """The folder in which Numba keeps machine code of this package, and how many bytes of it there are; None if it cannot."""
    stated = os.environ.get(VARIABLE)
    package = Path(__file__).resolve().parents[1]
    caches = {"Windows": "AppData/Local", "Darwin": "Library/Caches"}
    user = Path.home() / caches.get(platform.system(), ".cache")
    if stated:
        folder = Path(stated)
    elif _can_write(package / "compiled"):
        folder = package
    elif _can_write(user):
        folder = user / "numba"
    else:
        return None, 0
    return folder, sum(file.stat().st_size for file in folder.rglob("*.nb[ic]")) if folder.is_dir() else 0


def _extras() -> Iterator[Finding]:
    for extra, package in PACKAGES.items():
        if has_extra(extra):
            yield _finding(f"[{extra}]", f"{package} {_version(package)}: {USES[extra]}")
        else:
            yield _finding(f"[{extra}]", f"{USES[extra]}", "absent", f"{how_to_install(extra)}.")


def _drawing() -> Finding:
    if not has_extra("view"):
        return _finding("3D", "was not tried", "absent", f"drawing in 3D needs {how_to_install('view')}.")
    renderer = tried_renderer()
    if not renderer.name:
        advice = "pictures in 3D are left out; on Linux without a screen, install libegl1 or libosmesa6, or run under xvfb-run."
        return _finding("3D", f"cannot be drawn: {renderer.why_not}", "attention", advice)
    screen = sys.platform in ("win32", "darwin") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    where = "" if screen else "; there is no screen, so pictures go to files"
    slow = renderer.seconds > FAST_RENDERER_S
    advice = "the processor draws, not a graphics card: pictures take their time."
    value = f"{renderer.name}, first picture after {renderer.seconds:.1f} s{where}"
    return _finding("3D", value, *(("attention", advice) if slow else ()))
