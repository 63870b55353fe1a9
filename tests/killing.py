"""End a process at any one instant at which it changes the disk."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable

WRITING = {"open", "os.mkdir", "os.rename", "os.remove", "os.rmdir"}  # of Python's audit events
KILLED_CODE = 9


def killed_at(instant: int, work: Callable[[], object]) -> bool:
    """Whether a copy of this process was ended in its work, at its n-th change of the disk; False where it has fewer."""
    child = os.fork()
    if child == 0:
        count = 0

        def end(event: str, arguments: tuple[object, ...]) -> None:
            nonlocal count
            count += event in WRITING
            if count > instant:
                os._exit(KILLED_CODE)

        sys.addaudithook(end)
        try:
            work()
        finally:
            os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == KILLED_CODE
