"""Run the code blocks of the pages that are too slow for the tests, each page in an empty folder, and compare their output.

    python studies/benchmarks/doc_blocks.py [PAGE ...]

Prints the number of blocks of each page, its wall time, and the time that the page states. A page ends at its first block
that fails, or that prints something else than the page shows; the exit code is then 1. ``.ci/nightly`` calls this program.
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

from docs_blocks import OFF_SCREEN, SLOW, begins_with_a_result, follow, is_slow, pages, text_of, write_programs  # noqa: E402


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
    failed = 0
    print("| page | blocks | time | time stated |\n|---|---|---|---|", flush=True)
    for page in chosen:
        folder = top / page.replace("/", "-")
        folder.mkdir()
        try:
            count, wall_s = time_page(page, folder, programs)
            stated = SLOW.search(text_of(page))
            print(f"| {page} | {count} | {wall_s:.0f} s | {f'{stated[1]} s' if stated else ''} |", flush=True)
        except Exception as error:  # a block may raise anything; the other pages are run nevertheless
            failed += 1
            print(f"| {page} | failed: {error} | | |", flush=True)
    os.chdir(ROOT)
    shutil.rmtree(top)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
