"""Pages of the site that are made when it is built: called by mkdocs (see mkdocs.yml), never by hand.

``models/*/SOURCES.md`` stands at the top of the repository, where a reader of the sources looks for it; the site shows it
as a page.
"""

from __future__ import annotations

import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent
SOURCES = ("models/tongue/SOURCES.md", "models/specimen/SOURCES.md")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made here."""
    for name in SOURCES:
        text = (ROOT / name).read_text(encoding="utf-8")
        files.append(File.generated(config, name, content=text.replace("(../../docs/", "(../../")))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links that leave docs/ in the repository stay inside the site."""
    return re.sub(r"\]\((?:\.\./)+models/", "](../models/", markdown)
