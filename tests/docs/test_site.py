"""The site of docs/ builds without a warning: every page is in the navigation, every link and every anchor leads somewhere."""

from __future__ import annotations

import re
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


def test_the_reference_has_every_command_and_every_name(site):
    """Pages that are made from the program have each command, effect and Python name as a heading or a row."""
    import explicitfe
    from explicitfe.cli.app import COMMANDS, GROUPS
    from explicitfe.effects import EFFECTS

    commands = (site / "reference" / "cli.html").read_text(encoding="utf-8")
    names = [name for table in COMMANDS.values() for name in table]
    names += [f"{group}-{name}" for table in GROUPS.values() for group, (_, inner) in table.items() for name in inner]
    assert [name for name in names if f'id="{name}"' not in commands] == []
    scenario = (site / "reference" / "scenario-keys.html").read_text(encoding="utf-8")
    assert [name for name in EFFECTS if f"<code>[effects.{name}]</code>" not in scenario] == []
    python = (site / "reference" / "python.html").read_text(encoding="utf-8")
    assert [name for name in explicitfe.__all__ if name != "__version__" and f'id="{name.lower()}"' not in python] == []


def test_words_lead_to_the_glossary(site):
    """The first use of a word is a link to a heading that is there, with the meaning beside the pointer."""
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
def test_a_study_has_a_date_and_says_in_five_lines_what_it_found(study):
    abstract = study.read_text(encoding="utf-8").split("\n\n")[1]
    assert re.match(r"> \*Study of \d{4}-\d\d-\d\d\.\* \*\*In short\.\*\* ", abstract)
    assert len(abstract.splitlines()) <= 6


def test_the_gallery_has_twelve_pictures_with_the_command_that_makes_each():
    text = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    cards = text.split("\n-   ")[1:]
    assert len(cards) == 12
    for card in cards:
        command = re.search(r"^    `(explicitfe|python) ([^ `]+)", card, re.M)
        assert command, card
        assert command[1] == "explicitfe" or (ROOT / command[2]).is_file(), card
