"""Checks of the installation and the machine for ``explicitfe doctor``."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from explicitfe.app.view.opengl import tried_renderer
from explicitfe.platform.compiled.cache import VARIABLE, temporary_folder
from explicitfe.platform.compiled.jit import sample_compile_s
from explicitfe.platform.compiled.threads import cores
from explicitfe.platform.errors import Progress, silent
from explicitfe.platform.host.code_cache import can_write, kernel_folder
from explicitfe.platform.host.extras import PACKAGES, has_extra, how_to_install
from explicitfe.platform.host.load import is_busy, load
from explicitfe.platform.host.memory import available_bytes, in_words
from explicitfe.results.documents.examination import Examination, Finding, State
from explicitfe.results.files.provenance import provenance

LIBRARIES = ("numpy", "numba", "scipy", "h5py", "meshio", "pydantic", "typer")
# Purpose of each optional dependency.
USES = {
    "view": "3D views, GIF and MP4",
    "plots": "pictures as PNG, PDF, SVG",
    "parquet": "export to Parquet",
    "pandas": "tables as pandas.DataFrame",
    "sensitivity": "Sobol and Morris designs of sweeps",
    "cluster": "sweeps on a Dask cluster",
    "c3d": "recordings of motion capture in C3D files",
}
# A run of the finest tongue mesh needs less memory, and its result less disk space.
SMALLEST_MEMORY_BYTES = 2e9
SMALLEST_ROOM_BYTES = 1e9
# The kernels of a run of the tongue take so many times the CPU time of a small function, measured with numba 0.68.
KERNELS_PER_SAMPLE = 375
ROUND_TO_S = 5
# A picture that takes longer is rendered by the processor instead of a graphics card.
FAST_RENDERER_S = 10.0


def examine(folder: Path | str = ".", progress: Progress = silent) -> Examination:
    """Check versions, machine, output folder, compiled kernels and 3D graphics.

    Parameters
    ----------
    folder : output folder to check.
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
    yield _finding("explicitfe", f"{where['explicitfe'] or 'not installed'}{commit}, in {Path(__file__).resolve().parents[2]}")
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
    yield _finding("cores", f"{usable} of {present} are used{stated}")
    processes = load()
    if processes is not None:
        advice = "the machine is busy, so runs take longer and `explicitfe bench` is not reliable; wait until it is idle."
        yield _finding("load", f"{processes:.2f} in the last minute", *(("attention", advice) if is_busy(processes) else ()))
    memory = available_bytes()
    little = memory < SMALLEST_MEMORY_BYTES
    advice = "close other programs before a run with a fine mesh."
    yield _finding("memory", f"{in_words(memory)} free", *(("attention", advice) if little else ()))
    encoding = getattr(sys.stdout, "encoding", None) or "unknown"
    if encoding.lower().replace("-", "") != "utf8":
        advice = "characters such as ² and χ are printed as escape sequences; set PYTHONUTF8=1."
        yield _finding("terminal", f"encoding {encoding}", "attention", advice)


def _places(folder: Path) -> Iterator[Finding]:
    room = shutil.disk_usage(folder).free
    if not can_write(folder):
        yield _finding("results", f"{folder.resolve()} cannot be written", "attention", "choose another folder with --out.")
    elif room < SMALLEST_ROOM_BYTES:
        advice = "large results may not fit; choose a folder on another disk with --out."
        yield _finding("results", f"{in_words(room)} free in {folder.resolve()}", "attention", advice)
    else:
        yield _finding("results", f"{in_words(room)} free in {folder.resolve()}")
    yield _kernels()


def _kernels() -> Finding:
    """Where compiled kernels are stored."""
    name, folder, temporary = "compiled kernels", kernel_folder(), temporary_folder()
    if folder is None and temporary is None:
        advice = f"kernels are compiled again by each run, about a minute; set {VARIABLE} to a folder that you can write."
        return _finding(name, "no folder can be written", "attention", advice)
    if folder is None:
        advice = (
            "the package folder and the home folder cannot be written, and the system may delete a temporary folder; set "
            f"{VARIABLE} to a folder that you can write."
        )
        return _finding(name, f"stored in the temporary folder {temporary}", "attention", advice)
    size = sum(file.stat().st_size for file in folder.rglob("*.nb[ic]")) if folder.is_dir() else 0
    if not size:
        advice = (
            f"the first run takes about {_first_run_s()} s more on this machine; `explicitfe warmup` compiles the usual ones."
        )
        return _finding(name, f"none in {folder}", "absent", advice)
    return _finding(name, f"{in_words(size)} in {folder}")


def _first_run_s() -> int:
    """Estimated time of the compilation at a first run, s: from the CPU time of a small function."""
    return max(ROUND_TO_S, ROUND_TO_S * round(KERNELS_PER_SAMPLE * sample_compile_s() / min(2, cores()) / ROUND_TO_S))


def _extras() -> Iterator[Finding]:
    for extra, package in PACKAGES.items():
        if has_extra(extra):
            yield _finding(f"[{extra}]", f"{package} {_version(package)}: {USES[extra]}")
        else:
            yield _finding(f"[{extra}]", f"{USES[extra]}", "absent", f"{how_to_install(extra)}.")


def _drawing() -> Finding:
    if not has_extra("view"):
        return _finding("3D", "not checked", "absent", f"3D graphics need {how_to_install('view')}.")
    renderer = tried_renderer()
    if not renderer.name:
        advice = "3D pictures are omitted; on Linux without a display, install libegl1 or libosmesa6, or use xvfb-run."
        return _finding("3D", f"not available: {renderer.why_not}", "attention", advice)
    screen = sys.platform in ("win32", "darwin") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    where = "" if screen else "; no display, so pictures are written to files"
    slow = renderer.seconds > FAST_RENDERER_S
    advice = "the processor renders instead of a graphics card, so pictures are slow."
    value = f"{renderer.name}, first picture after {renderer.seconds:.1f} s{where}"
    return _finding("3D", value, *(("attention", advice) if slow else ()))
