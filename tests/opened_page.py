"""A page in a browser, as tests look at it and use it."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

WIDE, LAPTOP, NARROW = {"width": 1280, "height": 900}, {"width": 1366, "height": 768}, {"width": 390, "height": 844}
PATIENCE_MS = 60_000  # of a machine that does much else; docs/how-to/report.md says how long it takes on one that does not


def accessibility_faults(page: Any) -> list[str]:
    """What axe-core finds on an open page: its rules, how often each is broken, and where first."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page, options={"preload": False}).response["violations"]
    return [f"{rule['id']} x {len(rule['nodes'])}: {rule['nodes'][0]['html'][:200]}" for rule in found]


class Opened:
    """A page that is open and ready, with what it complained of, and what it asked of a network."""

    def __init__(self, browser: Any, path: Path, viewport: dict[str, int], **wishes: Any) -> None:
        context = browser.new_context(viewport=viewport, reduced_motion=wishes.pop("reduced_motion", "reduce"), **wishes)
        self.page = context.new_page()
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", lambda message: self.complaints.append(f"{message.type}: {message.text}"))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(path.as_uri())
        self.page.wait_for_selector("main[data-ready]", timeout=PATIENCE_MS)

    def picture(self, selector: str) -> np.ndarray:
        """What is on the screen, (height, width, 3)."""
        from PIL import Image

        return np.asarray(Image.open(io.BytesIO(self.page.locator(selector).first.screenshot())).convert("RGB"), dtype=int)

    def slide(self, value: float) -> None:
        """Move the slider as a reader does."""
        self.page.locator("[data-control=time]").evaluate(
            "(slider, value) => { slider.value = value; slider.dispatchEvent(new Event('input', { bubbles: true })); }", value
        )

    @property
    def clock(self) -> str:
        return str(self.page.locator(".clock").inner_text())

    def colour(self, name: str) -> list[float]:
        """Red, green and blue of the page's ground or letters, 0 to 255."""
        script = "(name) => getComputedStyle(document.body)[name].match(/[\\d.]+/g).slice(0, 3).map(Number)"
        numbers: list[float] = self.page.evaluate(script, name)
        return numbers

    @property
    def share_drawn(self) -> float:
        """Which share of the canvas is not its ground."""
        picture = self.picture("canvas")
        return float((np.abs(picture - picture[3, 20]).sum(axis=2) > 30).mean())
