"""A disk that is full from some write on: what it does to a run that stores five samples, and to going on when there is room."""

from __future__ import annotations

import errno
import io
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from tiny_result import add, check_steps, start

from explicitfe.platform.errors import InputError, RunError
from explicitfe.platform.host import files
from explicitfe.results.files import FINISHED, ResultWriter, disk, open_result

SAMPLES = 5


class FullDisk:
    """Counts what a program asks of the disk, and refuses from the ``left``-th question on.

    Attributes
    ----------
    left : questions that are answered; None for all.
    torn : whether of the first write that is refused a half gets through, where it lengthens the file.
    asked : questions so far.
    """

    def __init__(self, left: int | None, torn: bool = False) -> None:
        self.left, self.torn, self.asked = left, torn, 0

    def refuses(self) -> bool:
        """Ask the disk for something."""
        self.asked += 1
        return self.left is not None and self.asked > self.left

    def install(self, patch: pytest.MonkeyPatch) -> None:
        """Stand between the program and its disk."""
        full, error = self, OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        class Raw(io.FileIO):
            def write(self, data) -> int:
                if not full.refuses():
                    return super().write(data)
                end = os.fstat(self.fileno()).st_size
                if full.torn and self.tell() + len(data) > end and full.asked == full.left + 1:
                    return super().write(bytes(data)[: max(1, len(data) // 2)])
                raise error

        def asking(call):
            def ask(*args):
                if full.refuses():
                    raise error
                return call(*args)

            return ask

        patch.setattr(disk, "FileIO", Raw)
        for name in ("create_private", "reserve", "rename_new", "sync"):
            patch.setattr(files, name, asking(getattr(files, name)))


class Attempt(NamedTuple):
    """How a run on a full disk ended: "refused" before its first sample, "stopped", or "finished"."""

    ended: str
    sentence: str
    kept: int


def run_on(full: FullDisk, folder: Path, *, room_at_the_end: bool = False, expected: int = 1) -> Attempt:
    """Store five samples on a full disk; see that what is left is whole, and goes on to the right end once there is room.

    Parameters
    ----------
    room_at_the_end : whether the run itself finds room again when it ends.
    """
    path = folder / "a.vtkhdf"
    done, kept = 0, 0
    with pytest.MonkeyPatch.context() as patch:
        full.install(patch)
        ended, sentence, begun = "finished", "", False
        try:
            with start(path, expected_samples=expected) as run:
                begun = True
                try:
                    for done in range(SAMPLES):
                        add(run, done)
                except RunError as error:
                    sentence = str(error)
                    if not room_at_the_end:
                        raise
                    full.left = None
                run.finish(FINISHED if not sentence else "failed", sentence, {})
        except (InputError, RunError) as error:
            ended, sentence = "stopped" if begun and isinstance(error, RunError) else "refused", str(error)
    assert "\n" not in sentence
    if ended == "refused":
        assert [*folder.iterdir()] == [], f"{ended}: {sentence}"
        return Attempt(ended, sentence, 0)
    left = [*folder.iterdir()]
    if ended == "stopped" and not left:  # not even its first sample
        return Attempt(ended, sentence, 0)
    assert len(left) == 1
    with open_result(left[0]) as result:
        kept = len(result.times)
        assert kept >= done, f"{kept} of {done} samples: {sentence}"
        check_steps(result, kept)
        status = result.status
    if status != FINISHED:
        with ResultWriter.reopen(left[0]) as run:
            for step in range(SAMPLES):
                add(run, step)
            run.finish(FINISHED, "", {})
        left = [path]
    assert [*folder.iterdir()] == left
    with open_result(left[0]) as result:
        np.testing.assert_array_equal(result.times, 1e-3 * np.arange(SAMPLES))
        for step in range(SAMPLES):
            assert result.field("J", step).size == 2
    return Attempt(ended, sentence, kept)


def questions() -> int:
    """What a run asks of the disk from its beginning to its end."""
    import tempfile

    full = FullDisk(None)
    with tempfile.TemporaryDirectory() as folder:
        run_on(full, Path(folder))
    return full.asked
