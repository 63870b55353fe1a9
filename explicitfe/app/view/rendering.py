"""Pictures in three dimensions, drawn in a separate process.

Without OpenGL, or with a broken display, VTK does not raise an error: it crashes. The process runs
``python -m explicitfe.app.view.rendering``. It reads a job as JSON from stdin, and reports to stdout.
"""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from explicitfe.platform.errors import InputError, MachineError
from explicitfe.platform.host import stopping

# Without a graphics card a picture takes a second: a process without output for longer than this has stopped responding.
SILENCE_LIMIT_S = 120.0
LOOK_EVERY_S = 0.1
HOW_TO_RENDER = "on a computer without a screen VTK needs EGL or OSMesa (Debian, Ubuntu: install libegl1 or libosmesa6)"

Job = Literal["figures", "film", "window"]


class CannotRenderError(MachineError):
    """This machine cannot render: it has no OpenGL, or its display is broken."""


class Rendering:
    """A process that draws; :meth:`wait` waits for its end."""

    def __init__(self, child: subprocess.Popen[str], limited: bool) -> None:
        self._child, self._limited = child, limited
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._errors: list[str] = []
        self._readers = [threading.Thread(target=reader, daemon=True) for reader in (self._read_lines, self._read_errors)]
        for thread in self._readers:
            thread.start()

    def wait(self, progress: Callable[[float], None] = lambda share: None) -> None:
        """Wait until everything is drawn; ``progress`` is called repeatedly with the completed share.

        Raises
        ------
        InputError : the result, a name or a time cannot be used, or a file cannot be written there.
        CannotRenderError : this machine cannot render.
        MachineError : the disk is full.
        Stopped : a signal has requested to stop.
        """
        share, silent_s = 0.0, 0.0
        while True:
            progress(share)
            stopping.check()
            try:
                line = self._lines.get(timeout=LOOK_EVERY_S)
            except queue.Empty:
                silent_s += LOOK_EVERY_S
                if self._limited and silent_s > SILENCE_LIMIT_S:
                    raise CannotRenderError(f"this machine could not render it (no output for {SILENCE_LIMIT_S:g} s)") from None
                continue
            silent_s = 0.0
            if line is None:
                break
            said = json.loads(line)
            if "input" in said:
                raise InputError(said["input"])
            if "machine" in said:
                raise MachineError(said["machine"])
            if said.get("done"):
                self._child.wait()
                return
            share = float(said["share"])
        code = self._child.wait()
        self._readers[1].join()
        errors = [line.strip() for line in self._errors if line.strip()]
        why = errors[-1].rstrip(".") if errors and "Error" in errors[-1] else f"exit code {code}"
        raise CannotRenderError(f"this machine could not render it ({why}); {HOW_TO_RENDER}")

    def _read_lines(self) -> None:
        assert self._child.stdout is not None
        for line in self._child.stdout:
            self._lines.put(line)
        self._lines.put(None)

    def _read_errors(self) -> None:
        assert self._child.stderr is not None
        self._errors.extend(self._child.stderr)


@contextmanager
def rendering(job: Job, **given: object) -> Iterator[Rendering]:
    """A process that does a job in parallel; it is killed if it has not ended at the end of the block.

    Parameters
    ----------
    given : arguments of the job, as JSON can represent them.
    """
    root = str(Path(__file__).resolve().parents[3])
    path = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
    child = subprocess.Popen(
        [sys.executable, "-P", "-m", "explicitfe.app.view.rendering"],
        env=os.environ | {"PYTHONPATH": path},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
    )
    try:
        assert child.stdin is not None
        with child.stdin:
            json.dump({"job": job, "given": given}, child.stdin)
        yield Rendering(child, limited=job != "window")
    finally:
        child.kill()
        child.wait()


def job_of(name: Job) -> Callable[..., None]:
    """The function of a job; it takes the arguments of the job, and a function that is called with the completed share."""
    job: Callable[..., None]
    if name == "figures":
        from explicitfe.app.view.rendered import draw_figures

        job = draw_figures
    elif name == "film":
        from explicitfe.app.view.scene.film import make_film

        job = make_film
    else:
        from explicitfe.app.view.scene.window import open_window

        job = open_window
    return job


def main() -> None:
    """Entry point of the process: read a job from stdin, do it, and report to stdout."""
    said = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # output of libraries is not part of the protocol

    def say(**words: object) -> None:
        print(json.dumps(words), file=said, flush=True)

    order: Mapping[str, Any] = json.load(sys.stdin)
    try:
        job_of(order["job"])(**order["given"], progress=lambda share: say(share=share))
    except InputError as error:
        say(input=str(error))
    except MachineError as error:
        say(machine=str(error))
    except OSError as error:
        say(machine=f"cannot draw the picture ({error})")
    else:
        say(done=True)


if __name__ == "__main__":
    main()
