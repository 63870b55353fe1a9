"""What a reader copies from a page works: files are read, commands exist with their options, and blocks run.

Pages that say that they are slow are run by ``benchmarks/doc_blocks.py``; of these the commands are only looked up.
"""

from __future__ import annotations

import re
import shlex
import shutil
import tomllib
from pathlib import Path

import h5py
import pytest
from docs_blocks import (
    LANGUAGES,
    OFF_SCREEN,
    begins_with_a_result,
    blocks_of,
    commands_of,
    is_slow,
    pages,
    run_block,
    text_of,
    write_programs,
)
from support import ROOT

import explicitfe

# They have tests of their own: what the blocks print is compared too, and files are put into a copy of the package.
ELSEWHERE = ("docs/tutorials/python.md", "docs/reference/extending.md")
RUN = [
    page
    for page in pages()
    if page not in ELSEWHERE
    and not is_slow(page)
    and any(block.run and block.language in ("bash", "python") for block in blocks_of(page))
]


@pytest.mark.parametrize("page", pages())
def test_every_block_says_what_it_is(page):
    for block in blocks_of(page):
        assert block.language in LANGUAGES, (block.heading, block.text[:80])


@pytest.mark.parametrize("page", pages())
def test_every_command_exists_with_its_options(page):
    import typer

    from explicitfe.cli.app import app

    group = typer.main.get_command(app)
    for block in blocks_of(page):
        for line in commands_of(block) if block.language == "bash" else ():
            for part in re.split(r"\||&&|;", line):
                words = shlex.split(part.partition(">")[0], comments=True)
                if "explicitfe" in words:
                    place, arguments = group, words[words.index("explicitfe") + 1 :]
                    while arguments and hasattr(place, "commands"):
                        name, *arguments = arguments
                        assert name in place.commands or name.startswith("-"), line
                        place = place.commands.get(name, place)
                    place.make_context(place.name, arguments)  # raises where an option is unknown or an argument missing


@pytest.mark.parametrize("page", pages())
def test_every_table_can_be_read(page):
    for block in blocks_of(page):
        if block.language == "toml":
            tomllib.loads(block.text)


@pytest.fixture(scope="module")
def result(tmp_path_factory) -> Path:
    """A short run of vowel [i] on the coarse mesh, for the pages that begin with a result."""
    folder = tmp_path_factory.mktemp("result")
    settings = ["model.resolution=coarse", "analysis.duration_ms=100", "record.every_ms=4"]
    return Path(explicitfe.run(ROOT / "scenarios" / "vowel-i.toml", folder, settings=settings)["result"])


@pytest.fixture(scope="module")
def programs(tmp_path_factory) -> Path:
    return write_programs(tmp_path_factory.mktemp("shell") / "programs")


@pytest.mark.parametrize("page", RUN)
def test_a_page_can_be_followed(page, result, programs, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)  # as where Python is started in this folder
    for key, value in OFF_SCREEN.items():
        monkeypatch.setenv(key, value)
    if begins_with_a_result(page):
        Path("outputs").mkdir()
        shutil.copy(result, "outputs/vowel-i.vtkhdf")
    for block in blocks_of(page):
        run_block(block, programs)


def test_matlab_reads_what_is_there(result):
    """Every dataset that a MATLAB block reads is in a result; there is no MATLAB here to run it."""
    with h5py.File(result) as file:
        for page in pages():
            for block in blocks_of(page):
                if block.language == "matlab":
                    for place in re.findall(r"h5read(?:att)?\(\w+, '(/[^']*)'", block.text):
                        assert place in file, (page, place)


@pytest.mark.parametrize("page", [page for page in pages() if not re.match(r"docs/(studies|reference)/", page)])
def test_a_page_is_read_in_a_few_minutes(page):
    """1 500 words at most, but for studies and the reference."""
    assert len(re.sub(r"```.*?```", "", text_of(page), flags=re.S).split()) <= 1500
