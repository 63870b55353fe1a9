"""Run the code blocks of the pages that are too slow for the tests, each page in an empty folder, and compare their output.

    python studies/benchmarks/doc_blocks.py [PAGE ...]

Prints the number of blocks and the wall time of each page. A page ends at its first block that fails, or
that prints something else than the page shows.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from docs_blocks import OFF_SCREEN, begins_with_a_result, follow, is_slow, pages, write_programs  # noqa: E402


def time_page(page: str, folder: Path, programs: Path) -> tuple[int, float]:
    """Run a page in a folder; give the number of its blocks and the wall time [s]."""
    import explicitfe

    os.chdir(folder)
    if begins_with_a_result(page):
        explicitfe.run(ROOT / "scenarios" / "vowel-i.toml", "outputs")
    begun = time.perf_counter()
    return follow(page, programs), time.perf_counter() - begun


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("pages", nargs="*", metavar="PAGE", help="such as docs/tutorials/specimen.md; default: all slow pages")
    chosen = parser.parse_args().pages or [page for page in pages() if is_slow(page)]
    os.environ.update(OFF_SCREEN)
    top = Path(tempfile.mkdtemp())
    programs = write_programs(top / "programs")
    failed, rows = 0, []
    for page in chosen:
        folder = top / page.replace("/", "-")
        folder.mkdir()
        try:
            count, wall_s = time_page(page, folder, programs)
            rows.append(f"| {page} | {count} | {wall_s:.0f} s |")
        except Exception as error:  # a block may raise anything; the other pages are run nevertheless
            failed += 1
            rows.append(f"| {page} | failed: {error} | |")
    os.chdir(ROOT)
    shutil.rmtree(top)
    print("| page | blocks | time |\n|---|---|---|", *rows, sep="\n")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
