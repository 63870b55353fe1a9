"""How much memory a process may still take: that of the machine, and less where a container or a limit allows less."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

_BYTES_PER_KIB = 1024


def in_words(size_bytes: float) -> str:
    """A size of memory or of a file, as a sentence says it: in MB, or GB from one on."""
    return f"{size_bytes / 1e6:.3g} MB" if size_bytes < 1e9 else f"{size_bytes / 1e9:.3g} GB"


def available_bytes() -> float:
    """Memory that can be had without others being pushed out; infinite where this system does not say."""
    return min([_of_machine(), *_of_groups()])


def _of_machine() -> float:
    with contextlib.suppress(OSError, ValueError, IndexError):  # Linux
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return _BYTES_PER_KIB * float(line.split()[1])
    with contextlib.suppress(OSError, ValueError, AttributeError):  # macOS tells what there is, not what is free
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    return float("inf")


def _of_groups(root: Path = Path("/sys/fs/cgroup"), membership: Path = Path("/proc/self/cgroup")) -> Iterator[float]:
    """What the control groups around this process leave: of Linux, the second version and the first."""
    try:
        lines = membership.read_text(encoding="utf-8").splitlines()
    except OSError:
        return
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if controllers not in ("", "memory"):
            continue
        names = ("memory.max", "memory.current") if not controllers else ("memory.limit_in_bytes", "memory.usage_in_bytes")
        top = root if not controllers else root / "memory"
        here = top / path.strip("/")
        for folder in (here, *here.parents):
            # "max" is no number: no limit; and what a group has in caches can be had
            with contextlib.suppress(OSError, ValueError):
                limit, used = (float((folder / name).read_text(encoding="ascii")) for name in names)
                yield max(0.0, limit - used + _cached(folder))
            if folder == top:
                break


def _cached(folder: Path) -> float:
    with contextlib.suppress(OSError, ValueError):
        for line in (folder / "memory.stat").read_text(encoding="ascii").splitlines():
            name, value = line.split()
            if name in ("inactive_file", "total_inactive_file"):
                return float(value)
    return 0.0
