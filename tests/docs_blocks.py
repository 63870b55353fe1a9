"""Code blocks of README and the pages in docs/: read, run and compared with what they print.

Markup of a page:

- a paragraph that ends with a file name and a colon, such as "`bar.toml`:", names the file that the next block holds;
- ``<!-- not run: REASON -->`` on the line before a block: it is read and not run. In tutorials, how-to and start pages the reason
  must be one of :data:`ALLOWED_REASONS`;
- ``<!-- slow page: SECONDS -->`` anywhere: the tests only read its blocks, ``studies/benchmarks/doc_blocks.py`` runs them;
- a ``text`` block after a ``bash`` or ``python`` block of the same section is compared with its output on stdout, see
  :func:`check_output`.

All other blocks are run in the order of the page, in an empty folder. If the page does not compute the result
``outputs/vowel-i.vtkhdf``, it is provided.
"""

from __future__ import annotations

import contextlib
import io
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
_NOT_RUN = re.compile(r"<!-- not run: ([^\n]+) -->\s*$")
# Why a block of a tutorial, how-to or start page may be left unexecuted, as the beginning of the reason.
ALLOWED_REASONS = ("installation", "cluster")
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
_BOX_DRAWING = re.compile(r"[\u2500-\u257f]")
_FILE = re.compile(r"`([\w.-]+\.(?:toml|py|csv|m|sh))`[^`\n]*:\s*$")
_VOWEL = re.compile(r"explicitfe run vowel-i( --set \S+)*( --out outputs)?")
_SHELL = re.compile(r"[|&;<>$`()]")
# Environment in which blocks are run: pictures need no screen.
OFF_SCREEN = {"MPLBACKEND": "Agg", "PYVISTA_OFF_SCREEN": "true"}


class Block(NamedTuple):
    """A fenced block: its section, language and text, the file that it holds, and why it is not run."""

    heading: str
    language: str
    text: str
    file: str | None = None
    not_run: str | None = None

    @property
    def run(self) -> bool:
        return self.not_run is None


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
        reason = _NOT_RUN.search(before)
        file = _FILE.search(_NOT_RUN.sub("", before).rstrip())
        blocks.append(Block(heading, match[2], match[3], file[1] if file else None, reason[1] if reason else None))
    return blocks


def is_slow(page: str) -> bool:
    """Whether the tests only read the blocks of a page."""
    return SLOW.search(text_of(page)) is not None


def begins_with_a_result(page: str) -> bool:
    """Whether a page reads a result that it does not compute."""
    return not any(_VOWEL.fullmatch(line) for block in blocks_of(page) if block.run for line in commands_of(block))


def commands_of(block: Block) -> Iterator[str]:
    """The command lines of a block without comments; a line that ends with a backslash is joined with the next one."""
    for line in block.text.replace("\\\n", " ").splitlines():
        words = line.partition(" #")[0].strip()
        if words and not words.startswith("#"):
            yield words


def follow(page: str, programs: Path) -> int:
    """Run the blocks of a page in the current folder and compare what they print with the page; give their number."""
    output, section = "", None
    blocks = blocks_of(page)
    for block in blocks:
        if block.language == "text" and block.heading == section:
            check_output(block.text, output)
        else:
            output, section = run_block(block, programs), block.heading
    return len(blocks)


def run_block(block: Block, programs: Path) -> str:
    """Write the file that a block holds, or run its commands in the current folder; give what they print on stdout.

    Parameters
    ----------
    programs : folder with the programs that the shell runs as ``explicitfe`` and ``python``, see :func:`write_programs`.
    """
    if block.file is not None:
        Path(block.file).write_text(block.text, encoding="utf-8")
        return ""
    if not block.run or block.language not in ("bash", "python"):
        return ""
    lines = list(commands_of(block))
    if block.language == "bash" and not all(
        line.startswith("explicitfe ") and not _SHELL.search(_unquoted(line)) for line in lines
    ):
        environment = os.environ | {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", block.text], env=environment, check=False, stdout=subprocess.PIPE
        )
        assert done.returncode == 0, f"{block.text}: exit code {done.returncode}"
        return done.stdout.decode("utf-8")
    with contextlib.redirect_stdout(io.StringIO()) as output:
        if block.language == "python":
            exec(compile(block.text, f"block under {block.heading!r}", "exec"), {"__name__": "__main__"})
        else:
            for line in lines:
                code = command(_arguments(line))
                assert code == 0, f"{line}: exit code {code}"
    return output.getvalue()


def check_output(expected: str, output: str) -> None:
    """Compare a ``text`` block with what was printed.

    The block is an excerpt: its words appear in the output in this order, and ``...`` stands for any text. Frames of tables and
    line breaks are ignored. Numbers with decimals may differ by two units of their last digit, as processors round differently.
    """
    output, place = _without_layout(output), 0
    for part in map(str.strip, _without_layout(expected).split("...")):
        numbers = _NUMBER.findall(part)
        matches = re.compile(_NUMBER.sub(r"(-?\\d+(?:\\.\\d+)?)", _escaped(part))).finditer(output, place)
        found = next((match for match in matches if all(map(_is_same_number, numbers, match.groups()))), None)
        assert found, f"the page says\n    {expected}\nbut {part!r} does not follow in the output\n    {output[place:]}"
        place = found.end()


def _is_same_number(written: str, printed: str) -> bool:
    decimals = len(written.partition(".")[2])
    allowed = 2.0 * 10.0**-decimals if decimals else 0.0
    return abs(float(written) - float(printed)) <= allowed * (1.0 + 1e-9)


def _without_layout(text: str) -> str:
    return " ".join(_BOX_DRAWING.sub(" ", text).split())


def _escaped(text: str) -> str:
    """A regular expression for a text; numbers stay as they are, a minus sign included."""
    return "".join(piece if _NUMBER.fullmatch(piece) else re.escape(piece) for piece in re.split(f"({_NUMBER.pattern})", text))


def _arguments(line: str) -> list[str]:
    """Arguments of a plain command, with patterns such as ``outputs/*.vtkhdf`` expanded."""
    return [name for word in shlex.split(line)[1:] for name in (sorted(map(str, Path().glob(word))) if "*" in word else [word])]


def _unquoted(line: str) -> str:
    """A command without its quoted parts, in which the shell expands nothing."""
    return re.sub(r"'[^']*'", "", line)


def write_programs(folder: Path) -> Path:
    """Write the programs of this installation that pages call into a folder for the ``PATH`` of a shell."""
    folder.mkdir()
    for name, words in (("explicitfe", "-m explicitfe"), ("python", ""), ("dask", "-m dask")):
        program = folder / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {words} "$@"\n', encoding="utf-8")
        program.chmod(0o755)
    return folder
