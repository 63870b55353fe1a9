"""Names of files in the terminal: each on a line of its own that is never folded, so that it can be copied."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group
from rich.text import Text


def file_lines(files: Sequence[tuple[str, str]]) -> Group:
    """Lines of what a file is and its name."""
    width = max((len(label) for label, _ in files), default=0)
    lines = "\n".join(f"{label:{width}}  {name}" for label, name in files)
    if not lines:
        return Group()
    return Group(Text(lines, no_wrap=True, overflow="ignore"))  # a text that is printed by itself is folded nevertheless
