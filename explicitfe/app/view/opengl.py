"""Test whether this machine can render, in a separate process, because VTK crashes without OpenGL.

The process is this module, started as ``python -m explicitfe.app.view.opengl``; it prints the renderer, or ends in an error.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

# Without a graphics card the first picture takes some seconds: a process that takes longer than this hangs.
TRIAL_LIMIT_S = 60.0
PICTURE_DOTS = 64
_RENDERER = "OpenGL renderer string:"


class Renderer(NamedTuple):
    """What draws, empty where nothing does; why not; and how long the first picture took [s]."""

    name: str
    why_not: str
    seconds: float


def tried_renderer() -> Renderer:
    """Draw a small picture."""
    root = str(Path(__file__).resolve().parents[3])
    path = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
    begin = time.perf_counter()
    try:
        trial = subprocess.run(
            [sys.executable, "-P", "-m", "explicitfe.app.view.opengl"],
            env=os.environ | {"PYTHONPATH": path},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=TRIAL_LIMIT_S,
        )
    except subprocess.TimeoutExpired:
        return Renderer("", f"it hung for {TRIAL_LIMIT_S:g} s", TRIAL_LIMIT_S)
    seconds = time.perf_counter() - begin
    if trial.returncode == 0:
        return Renderer(trial.stdout.strip(), "", seconds)
    last = trial.stderr.strip().splitlines()[-1:] or [f"exit code {trial.returncode}"]
    return Renderer("", last[0][:200], seconds)


def main() -> None:
    """Draw a sphere, and print what has drawn it."""
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=[PICTURE_DOTS, PICTURE_DOTS])
    plotter.add_mesh(pyvista.Sphere(), color="red")
    picture = plotter.screenshot(return_img=True)
    if picture is None or picture.min() == picture.max():
        sys.exit("the picture is empty")
    report = plotter.render_window.ReportCapabilities() if plotter.render_window else ""
    names = [line.partition(":")[2].strip() for line in report.splitlines() if _RENDERER in line]
    print(names[0] if names else "unknown")


if __name__ == "__main__":
    main()
