"""Code blocks of README and the pages in docs/: what a reader copies.

A page says of its blocks

- by the words before it, which file a block is: a paragraph that ends with a file's name and a colon, such as "`bar.toml`:";
- ``<!-- not run: REASON -->`` on the line before a block: it is read, and not run, such as one that installs something;
- ``<!-- slow page: SECONDS -->`` anywhere: the tests read its blocks, and ``benchmarks/doc_blocks.py`` runs them.

All else is run in the order of the page, in a folder that is empty but for a result ``outputs/vowel-i.vtkhdf``, where the page
does not compute that itself.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from command import command
from support import ROOT

LANGUAGES = {"bash", "python", "toml", "csv", "json", "text", "matlab", "diff"}
SLOW = re.compile(r"<!-- slow page: (\d+) s -->")
_BLOCK = re.compile(r"^#+ ([^\n]+)$|^```(\w*)\n(.*?)^```$", re.M | re.S)
_NOT_RUN = re.compile(r"<!-- not run: [^\n]+ -->\s*$")
_FILE = re.compile(r"`([\w.-]+\.(?:toml|py|csv|m))`[^`\n]*:\s*$")
_VOWEL = re.compile(r"explicitfe run vowel-i( --set \S+)*( --out outputs)?")
_SHELL = re.compile(r"[|&;<>$`()]")
# Set where a page's blocks are run: pictures need no screen.
OFF_SCREEN = {"MPLBACKEND": "Agg", "PYVISTA_OFF_SCREEN": "true"}


class Block(NamedTuple):
    """A fenced block: its heading, language and text; the file that it is, and whether it is run."""

    heading: str
    language: str
    text: str
    file: str | None = None
    run: bool = True


def pages() -> list[str]:
    """All pages: README.md, CONTRIBUTING.md, and those of docs/, relative to the top of the repository."""
    return ["README.md", "CONTRIBUTING.md", *sorted(str(path.relative_to(ROOT)) for path in (ROOT / "docs").rglob("*.md"))]


def text_of(page: str) -> str:
    """The text of a page, named relative to the top of the repository or to docs/."""
    path = ROOT / page
    return (path if path.is_file() else ROOT / "docs" / page).read_text(encoding="utf-8")


def blocks_of(page: str) -> list[Block]:
    """Fenced blocks of a page, in order."""
    blocks, heading, text = [], "", text_of(page)
    for match in _BLOCK.finditer(text):
        if match[1]:
            heading = match[1]
            continue
        before = text[: match.start()].rstrip()
        runs = _NOT_RUN.search(before) is None
        file = _FILE.search(before if runs else _NOT_RUN.sub("", before).rstrip())
        blocks.append(Block(heading, match[2], match[3], file[1] if file else None, runs))
    return blocks


def is_slow(page: str) -> bool:
    """Whether the tests only read its blocks."""
    return SLOW.search(text_of(page)) is not None


def begins_with_a_result(page: str) -> bool:
    """Whether it reads a result that it does not compute."""
    return not any(_VOWEL.fullmatch(line) for block in blocks_of(page) if block.run for line in commands_of(block))


def commands_of(block: Block) -> Iterator[str]:
    """The lines of a block for the shell, without comments; lines that end with a backslash go on."""
    for line in block.text.replace("\\\n", " ").splitlines():
        words = line.partition(" #")[0].strip()
        if words and not words.startswith("#"):
            yield words


def run_block(block: Block, programs: Path) -> None:
    """Do in the current folder what a block says.

    Parameters
    ----------
    programs : folder with the programs that the shell runs as ``explicitfe`` and ``python``, see :func:`write_programs`.
    """
    if block.file is not None:
        Path(block.file).write_text(block.text, encoding="utf-8")
    elif not block.run:
        return
    elif block.language == "python":
        exec(compile(block.text, f"block under {block.heading!r}", "exec"), {"__name__": "__main__"})
    elif block.language == "bash":
        lines = list(commands_of(block))
        if all(line.startswith("explicitfe ") and not _SHELL.search(_unquoted(line)) for line in lines):
            for line in lines:
                code = command(_arguments(line))
                assert code == 0, f"{line}: exit code {code}"
        else:
            environment = os.environ | {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
            code = subprocess.run(["bash", "-euo", "pipefail", "-c", block.text], env=environment, check=False).returncode
            assert code == 0, f"{block.text}: exit code {code}"


def _arguments(line: str) -> list[str]:
    """Those of a plain command, with the files that a pattern such as ``outputs/*.vtkhdf`` stands for."""
    return [name for word in shlex.split(line)[1:] for name in (sorted(map(str, Path().glob(word))) if "*" in word else [word])]


def _unquoted(line: str) -> str:
    """A command without what stands in quotes, which the shell leaves alone."""
    return re.sub(r"'[^']*'", "", line)


def write_programs(folder: Path) -> Path:
    """Programs ``explicitfe`` and ``python`` of this installation, in a folder that the shell looks in first."""
    folder.mkdir()
    for name, words in (("explicitfe", "-m explicitfe"), ("python", "")):
        program = folder / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {words} "$@"\n', encoding="utf-8")
        program.chmod(0o755)
    return folder
