"""Link the first use of a term on a page to the glossary."""

from __future__ import annotations

import html as markup
import re
from pathlib import Path

from pymdownx.slugs import slugify

_HEADING = re.compile(r"^### (.+)\n+(.+)$", re.M)
_TAG = re.compile(r"(<[^>]+>)")
_LINK_IN_TEXT = re.compile(r"\[([^]]*)\]\([^)]*\)")
# Text in these elements is not linked.
_CLOSED = ("a", "code", "math", "pre", "h1", "h2", "h3", "h4", "th", "script", "style")


class Glossary:
    """Terms of the glossary with their definitions.

    Every heading of the third level is a term or several terms separated by commas: ``### hexahedron, hex8, element``.
    """

    def __init__(self, path: Path) -> None:
        slug = slugify(case="lower")
        self.entries: dict[str, tuple[str, str]] = {}
        for heading, meaning in _HEADING.findall(path.read_text(encoding="utf-8")):
            sentence = _LINK_IN_TEXT.sub(r"\1", meaning).replace("*", "").replace("`", "")
            for word in heading.split(", "):
                self.entries[word.strip().lower()] = (slug(heading, "-"), sentence)
        words = sorted(map(re.escape, self.entries), key=len, reverse=True)
        self._pattern = re.compile(rf"(?<![\w-])({'|'.join(words)})(?:s|es)?(?![\w-])", re.I)

    def linked(self, page: str, url: str) -> str:
        """Give a page with the first use of each term as a link; text in code, headings and links is not changed."""
        seen: set[str] = set()
        closed = 0
        pieces = _TAG.split(page)
        for number, piece in enumerate(pieces):
            if number % 2:
                name = piece.strip("</>").split()[0].lower() if piece.strip("</>") else ""
                if name in _CLOSED:
                    closed += -1 if piece.startswith("</") else 1
            elif not closed:
                pieces[number] = self._pattern.sub(lambda match: self._link(match, url, seen), piece)
        return "".join(pieces)

    def _link(self, match: re.Match[str], url: str, seen: set[str]) -> str:
        anchor, sentence = self.entries[match[1].lower()]
        if anchor in seen:
            return match[0]
        seen.add(anchor)
        return f'<a class="term" href="{url}#{anchor}" title="{markup.escape(sentence)}">{match[0]}</a>'
