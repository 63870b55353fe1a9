"""The site of docs/ builds without a warning; links of its pages also lead to files of the repository."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from docs_blocks import pages, text_of
from opened_page import NARROW, PATIENCE_MS, WIDE, accessibility_faults
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


@pytest.mark.parametrize("page", ["SUPPORT.md", *pages()])
def test_links_lead_to_files_of_the_repository(page):
    """Links also work outside the built site, so no page links to one that exists only there."""
    links = re.findall(r"\]\(([^)#\s]+)[^)]*\)", text_of(page))
    assert [link for link in links if "://" not in link and not (ROOT / page).parent.joinpath(link).exists()] == []


def test_pages_load_nothing_from_other_servers(site):
    """Scripts, styles, fonts and pictures are part of the site; links may lead elsewhere."""
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        for attribute in ('src="http', 'src="//', 'rel="stylesheet" href="http', 'rel="preconnect"'):
            assert attribute not in text, (page, attribute)


def test_the_search_works_where_a_page_is_opened_as_a_file(site: Path, browser: Any) -> None:
    """README.md leads to a file of the site, not to a server; pages in folders find the index too."""
    page, requests = browser.new_page(), []
    page.on("request", lambda request: requests.append(request.url))
    for name in ("index.html", "reference/mechanics.html"):
        page.goto((site / name).as_uri())
        page.locator(".md-search__input").first.click()
        page.keyboard.type("hourglass")
        page.wait_for_selector(".md-search-result__item", timeout=PATIENCE_MS)
        assert page.locator(".md-search-result__item").count() > 5
    page.click(".md-search-result__item a")
    assert "h=hourglass" in page.url and "hourglass" in page.inner_text("main").lower()
    assert [url for url in requests if not url.startswith("file:")] == []


def test_pages_are_accessible(site: Path, browser: Any) -> None:
    """axe-core finds nothing on pages with formulas, tables and code, on a wide and on a narrow screen."""
    for name in ("index.html", "reference/mechanics.html", "reference/scenario-keys.html", "tutorials/what-is-missing.html"):
        for viewport in (WIDE, NARROW):
            page = browser.new_page(viewport=viewport)
            page.goto((site / name).as_uri())
            page.wait_for_timeout(500)  # site.js waits for the theme
            assert accessibility_faults(page) == [], name


def test_every_page_is_there(site):
    pages = {path.relative_to(ROOT / "docs").with_suffix(".html") for path in (ROOT / "docs").rglob("*.md")}
    assert pages <= {path.relative_to(site) for path in site.rglob("*.html")}


def test_the_reference_has_every_command_and_every_name(site):
    """Generated pages contain each command, effect and Python name."""
    import explicitfe
    from explicitfe.app.cli.app import COMMANDS, GROUPS
    from explicitfe.fem.effects import EFFECTS

    commands = (site / "reference" / "cli.html").read_text(encoding="utf-8")
    names = [name for table in COMMANDS.values() for name in table]
    names += [f"{group}-{name}" for table in GROUPS.values() for group, (_, inner) in table.items() for name in inner]
    assert [name for name in names if f'id="{name}"' not in commands] == []
    scenario = (site / "reference" / "scenario-keys.html").read_text(encoding="utf-8")
    assert [name for name in EFFECTS if f"<code>[effects.{name}]</code>" not in scenario] == []
    python = (site / "reference" / "python.html").read_text(encoding="utf-8")
    assert [name for name in explicitfe.__all__ if name != "__version__" and f'id="{name.lower()}"' not in python] == []


def test_terms_link_to_the_glossary(site):
    """The first use of a term is a link to its definition in the glossary."""
    glossary = (site / "explanation" / "glossary.html").read_text(encoding="utf-8")
    links = set()
    for page in (*(site / "tutorials").glob("*.html"), *(site / "studies").glob("*.html")):
        links |= set(
            re.findall(
                r'<a class="term" href="\.\./explanation/glossary\.html#([^"]+)" title="[^"]+', page.read_text(encoding="utf-8")
            )
        )
    assert len(links) > 30
    assert [anchor for anchor in links if f'id="{anchor}"' not in glossary] == []


@pytest.mark.parametrize("study", sorted((ROOT / "docs" / "studies").glob("[!i]*.md")), ids=lambda path: path.stem)
def test_a_study_has_a_date_and_a_short_abstract(study):
    abstract = study.read_text(encoding="utf-8").split("\n\n")[1]
    assert re.match(r"> \*Study of \d{4}-\d\d-\d\d\.\* \*\*In short\.\*\* ", abstract)
    assert len(abstract.splitlines()) <= 6


def test_the_gallery_has_thirteen_pictures_with_their_commands():
    text = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    cards = text.split("\n-   ")[1:]
    assert len(cards) == 13
    for card in cards:
        command = re.search(r"^    `(explicitfe|python) ([^ `]+)", card, re.M)
        assert command, card
        assert command[1] == "explicitfe" or (ROOT / command[2]).is_file(), card
