"""Makes ``tests/support.py`` and the benchmarks importable from every folder of tests, and the package from a plain checkout."""

from __future__ import annotations

import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

# Numba colours the messages that it discards while it infers types, for a twentieth of the time to compile.
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")

# Two test processes whose libraries start threads for products of small matrices wait for each other, for a minute at a time.
# The command line sets the same.
for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

HERE = Path(__file__).resolve().parent
for folder in (HERE, HERE.parent / "studies" / "benchmarks", HERE.parent):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))

# Several test processes leave no core free for a further compiler process, which would only increase the CPU time.
if "PYTEST_XDIST_WORKER" in os.environ:
    from explicitfe.platform.compiled import pieces

    pieces.cores = lambda: 1

# Whoever starts the tests in the background of a script has them ignore Ctrl-C, and the runs that tests stop by it would go on.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def record_property(record_property: Callable[[str, object], None]) -> Callable[[str, object], None]:
    """pytest's own, with values as text: tests that run beside each other cannot send numbers of numpy."""
    return lambda name, value: record_property(name, str(value))


# Of Chromium: without a sandbox, as root needs, and with WebGL drawn by the processor.
CHROMIUM_ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """The Chromium of the system, or the one that playwright installs."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="pages are tested with playwright: pip install playwright")
    # A loop of playwright that is open would be in the way of tests that start their own.
    with sync_api.sync_playwright() as playwright:
        names = ("chromium", "chromium-browser", "google-chrome")
        own = next((path for path in map(shutil.which, names) if path), None)
        if own is None and not Path(playwright.chromium.executable_path).exists():
            pytest.skip("there is no Chromium here: install it, or run `playwright install chromium`")
        with playwright.chromium.launch(executable_path=own, args=CHROMIUM_ARGUMENTS) as started:
            yield started
