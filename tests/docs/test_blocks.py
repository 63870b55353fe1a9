"""Code blocks of the documentation: files are valid, commands and options exist, blocks run and print what the page shows.

Pages marked as slow are run by ``studies/benchmarks/doc_blocks.py``; here only their commands are checked.
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
    ALLOWED_REASONS,
    LANGUAGES,
    OFF_SCREEN,
    begins_with_a_result,
    blocks_of,
    check_output,
    commands_of,
    follow,
    is_slow,
    pages,
    text_of,
    write_programs,
)
from support import ROOT

import explicitfe

pytestmark = pytest.mark.slow

# These pages have tests of their own: test_python_page.py, and test_extending.py, which works on a copy of the package.
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
def test_every_command_exists_with_its_options(page, monkeypatch):
    import typer

    from explicitfe.app.cli.app import app

    monkeypatch.setattr("explicitfe.app.cli.command.find_result", lambda path: path)  # no result is needed to parse a command
    group = typer.main.get_command(app)
    for block in blocks_of(page):
        for line in commands_of(block) if block.language == "bash" else ():
            for part in re.split(r"\||&&?|;", line):
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
    follow(page, programs)


@pytest.mark.parametrize("page", [page for page in pages() if not re.match(r"docs/(studies|reference)/", page)])
def test_all_blocks_are_executed(page):
    """Only installation, and commands for a cluster on their page, may be marked as not run, or hide in a block of text."""
    for block in blocks_of(page):
        if block.not_run is not None:
            assert block.not_run.startswith(ALLOWED_REASONS), (block.heading, block.not_run)
            assert page == "docs/how-to/cluster.md" or not block.not_run.startswith("cluster"), block.heading
        if block.language == "text":
            assert not re.search(r"^(explicitfe|python) ", block.text, re.M), f"{block.heading}: mark this block as bash"


def test_output_is_compared():
    """Words, their order and numbers are compared; frames, line breaks and what ``...`` stands for are not."""
    output = "│ tip │ forward 4.27, up 1.55 mm,  │\n│     │ at 1 mm/s │\nresult  outputs/a.vtkhdf"
    check_output("tip  forward 4.26, up 1.57 mm, at 1 mm/s", output)
    check_output("tip ... mm/s\n...\nresult outputs/a.vtkhdf", output)
    for wrong in ("tip forward 4.24", "tip backward 4.27", "at 2 mm/s", "result ... tip"):
        with pytest.raises(AssertionError):
            check_output(wrong, output)


def test_matlab_reads_what_is_there(result):
    """Every dataset that a MATLAB block reads is in a result; MATLAB itself is not run."""
    with h5py.File(result) as file:
        for page in pages():
            for block in blocks_of(page):
                if block.language == "matlab":
                    for place in re.findall(r"h5read(?:att)?\(\w+, '(/[^']*)'", block.text):
                        assert place in file, (page, place)


@pytest.mark.parametrize("page", [page for page in pages() if not re.match(r"docs/(studies|reference)/", page)])
def test_a_page_is_read_in_a_few_minutes(page):
    """1 500 words at most, except for studies and the reference."""
    assert len(re.sub(r"```.*?```", "", text_of(page), flags=re.S).split()) <= 1500
