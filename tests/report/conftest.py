"""The browser of the tests of pages."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]


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
        with playwright.chromium.launch(executable_path=own, args=ARGUMENTS) as started:
            yield started
