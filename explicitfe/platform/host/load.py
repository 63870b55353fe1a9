"""How busy a machine is with other work."""

from __future__ import annotations

import os

# Processes that want to compute, per core: from here on times say more of the others than of this program.
BUSY_SHARE_OF_CORES = 0.5


def load() -> float | None:
    """Processes that wanted to compute in the last minute, on average; None where the system does not say."""
    try:
        return os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    except OSError:
        return None


def is_busy(processes: float | None) -> bool:
    """Whether so many processes leave a program waiting."""
    return processes is not None and processes > BUSY_SHARE_OF_CORES * (os.cpu_count() or 1)
