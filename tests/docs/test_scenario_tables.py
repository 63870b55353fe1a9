"""Tables and texts of the documentation state the numbers that the scenarios expect, which tests compare with runs."""

from __future__ import annotations

import re
import sys

import pytest
from docs_blocks import text_of
from support import ROOT

sys.path.insert(0, str(ROOT / "docs" / "generate"))
import scenario_tables


@pytest.mark.parametrize("name", scenario_tables.TABLES)
def test_a_table_is_what_the_scenarios_expect(name: str) -> None:
    """Update it with: python docs/generate/scenario_tables.py"""
    page, make = scenario_tables.TABLES[name]
    begin, end = scenario_tables.marks(name)
    assert text_of(page).partition(begin)[2].partition(end)[0] == make()


def test_contacts_in_palatograms() -> None:
    rows = re.findall(r"^\| ((?:`[\w-]+`(?:, )?)+)(?: at 140 ms)? \| (\d+) \|", text_of("docs/reference/measures.md"), re.M)
    stated = {name: int(count) for names, count in rows for name in re.findall(r"[\w-]+", names)}
    assert len(stated) == 12
    assert stated == {name: scenario_tables.scenario(name).expected[0]["palatogram.now.contacts"] for name in stated}


def test_the_first_film_belongs_to_the_first_command() -> None:
    """Scenario, picture, caption, commands and duration of README and start page."""
    for page in ("README.md", "docs/index.md"):
        text = text_of(page)
        name = re.findall(r"explicitfe run ([\w-]+)", text)[0]
        scenario = scenario_tables.scenario(name)
        shown = re.findall(r"!\[([^]]+(?:\[i\])?[^]]*)\]\((?:docs/)?pictures/([\w-]+)\.(?:png|gif)\)", text)
        assert shown and all(picture.startswith(name) for _, picture in shown), (page, shown)
        assert all(f"{scenario.analysis.duration_ms:g} ms" in words for words, _ in shown)
        assert set(re.findall(r"outputs/([\w-]+)\.vtkhdf", text)) == {name}
