"""Code blocks of the pages in docs/: what a reader copies."""

from __future__ import annotations

import re
from typing import NamedTuple

from support import ROOT


class Block(NamedTuple):
    """A fenced block: its heading, language and text."""

    heading: str
    language: str
    text: str


def blocks_of(page: str) -> list[Block]:
    """Fenced blocks of a page of docs/, in order."""
    blocks, heading = [], ""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    for match in re.finditer(r"^#+ ([^\n]+)$|^```(\w*)\n(.*?)^```$", text, re.M | re.S):
        if match[1]:
            heading = match[1]
        else:
            blocks.append(Block(heading, match[2], match[3]))
    return blocks
