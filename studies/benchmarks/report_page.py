"""How large the report of vowel-i is, when its first picture stands in a browser, and how many pictures a second it draws.

    python studies/benchmarks/report_page.py [RESULT]

Without a result, vowel-i is run first. The browser is the Chromium of the system; where it has no graphics card, as on a server,
the processor draws, and what else the machine does counts: the load is printed with the numbers.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

from explicitfe.app.view.page.run.write import write_report
from explicitfe.simulate.run.run import run

ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
SCREENS = {"1280 x 900": (1280, 900), "390 x 844": (390, 844)}
# What the page promises on a machine that does nothing else.
MOST_MB, MOST_SECONDS_TO_FIRST_PICTURE, FEWEST_PICTURES_PER_S = 6.0, 2.0, 20.0
WATCHED_S = 4.0
OPENINGS = 3


def measured(browser: Browser, page_path: Path, size: tuple[int, int]) -> tuple[float, float]:
    """Seconds from the click on the file to the first picture, and pictures per second while it plays."""
    page = browser.new_page(viewport={"width": size[0], "height": size[1]})
    begin = time.perf_counter()
    page.goto(page_path.as_uri())
    page.wait_for_selector("main[data-ready]", timeout=60_000)
    first_s = time.perf_counter() - begin

    def drawn() -> int:
        return int(page.get_attribute("main", "data-drawn") or 0)

    page.keyboard.press("Home")
    page.keyboard.press("Space")
    # Slowly, so that it does not come to its end meanwhile.
    page.locator("[data-control=speed]").evaluate("(choice) => { choice.value = '0.25'; }")
    time.sleep(1.0)
    count, begin = drawn(), time.perf_counter()
    time.sleep(WATCHED_S)
    rate = (drawn() - count) / (time.perf_counter() - begin)
    page.close()
    return first_s, rate


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        result = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(run("vowel-i", folder)["result"])
        begin = time.perf_counter()
        answer = write_report([result], Path(folder) / "report.html")
        print(f"written in {time.perf_counter() - begin:.1f} s, {answer['size_MB']:.2f} MB (at most {MOST_MB:g})")
        names = map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))
        own = next(filter(None, names), None)
        with sync_playwright() as playwright, playwright.chromium.launch(executable_path=own, args=ARGUMENTS) as browser:
            for name, size in SCREENS.items():
                runs = [measured(browser, Path(answer["report"]), size) for _ in range(OPENINGS)]
                first_s, rate = min(first for first, _ in runs), max(rate for _, rate in runs)
                print(
                    f"{name}: first picture after {first_s:.2f} s (at most {MOST_SECONDS_TO_FIRST_PICTURE:g}), "
                    f"{rate:.0f} pictures per second (at least {FEWEST_PICTURES_PER_S:g}); best of {OPENINGS}"
                )
        print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
