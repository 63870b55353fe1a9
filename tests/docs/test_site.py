"""The site of docs/ builds without a warning: every page is in the navigation, every link and every anchor leads somewhere."""

from __future__ import annotations

from pathlib import Path

import pytest
from support import ROOT

pytest.importorskip("material", reason='the site is built with mkdocs-material: pip install "explicitfe[docs]"')


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The folder of the built site."""
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    folder = tmp_path_factory.mktemp("site")
    build(load_config(str(ROOT / "mkdocs.yml"), site_dir=str(folder), strict=True))  # raises where there is a warning
    return folder


def test_pages_ask_nothing_of_a_network(site):
    """No script, style, font or picture comes from elsewhere; links that a reader follows may."""
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        for attribute in ('src="http', 'src="//', 'rel="stylesheet" href="http', 'rel="preconnect"'):
            assert attribute not in text, (page, attribute)


def test_every_page_is_there(site):
    pages = {path.relative_to(ROOT / "docs").with_suffix(".html") for path in (ROOT / "docs").rglob("*.md")}
    assert pages <= {path.relative_to(site) for path in site.rglob("*.html")}
