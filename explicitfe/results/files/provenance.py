"""Where a result comes from: what has to be known to compute it again."""

from __future__ import annotations

import os
import platform
import subprocess
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from typing_extensions import TypedDict


class Provenance(TypedDict):
    """Versions (None where not installed), commit, machine and start time of a run.

    ``commit`` is None outside a git checkout and ends in ``-dirty`` when files were changed; ``started_utc`` is ISO 8601.
    """

    explicitfe: str | None
    numpy: str | None
    numba: str | None
    h5py: str | None
    python: str
    commit: str | None
    platform: str
    processor: str
    cores: int | None
    started_utc: str


def provenance() -> Provenance:
    """Where a run comes from that starts now, on this machine."""
    return {
        "explicitfe": version_of("explicitfe"),
        "numpy": version_of("numpy"),
        "numba": version_of("numba"),
        "h5py": version_of("h5py"),
        "python": platform.python_version(),
        "commit": _commit(Path(__file__).resolve().parents[3]),
        "platform": platform.platform(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "started_utc": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def version_of(package: str) -> str | None:
    """The version of an installed package."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _commit(checkout: Path) -> str | None:
    """Commit of the checkout that this file lies in; None where it is installed, or git is missing or refuses."""
    if not (checkout / ".git").exists():
        return None
    # `git describe --dirty` locks the index in spite of --no-optional-locks, which disturbs a git at work; these two do not.
    git = ["git", "--no-optional-locks", "-C", str(checkout)]
    try:
        commit, changed = (
            subprocess.run([*git, *words], capture_output=True, text=True, timeout=5, check=True).stdout.strip()
            for words in (("rev-parse", "HEAD"), ("status", "--porcelain", "--untracked-files=no"))
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return f"{commit}-dirty" if changed else commit


def _processor() -> str:
    """Name of the processor; Python itself leaves it empty on many Linux systems."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
