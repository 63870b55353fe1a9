"""The table of thresholds: the page prints it, the report holds it, and the statistics know nothing but numbers."""

from __future__ import annotations

import dataclasses

import pytest
from support import ROOT

from explicitfe.inverse.close_loop.report import new_report
from explicitfe.inverse.close_loop.split import Split
from explicitfe.inverse.close_loop.thresholds import THRESHOLDS, entries, markdown_table
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.results.documents.loop_report import LoopReport

PAGE = ROOT / "docs" / "reference" / "close-loop-thresholds.md"


def test_the_page_prints_the_table():
    """Made by the command that stands above it in the page."""
    text = PAGE.read_text(encoding="utf-8")
    printed = text.partition("<!-- begin thresholds")[2].partition("-->\n")[2].partition("<!-- end thresholds")[0]
    assert printed == markdown_table()


def test_there_are_few_thresholds():
    """Numbers that only steer a computation stand beside the code that uses them."""
    assert len(entries()) <= 15


def test_every_threshold_has_a_unit_and_a_reason():
    for name, value, unit, reason in entries():
        assert "_" in name and value > 0.0 and unit and reason.endswith("."), name
        assert "|" not in unit + reason, f"{name}: a bar would end the cell of the table"
    with pytest.raises(dataclasses.FrozenInstanceError):
        THRESHOLDS.decisive_probability = 0.05  # type: ignore[misc]


def test_a_report_holds_the_thresholds(tmp_path):
    (tmp_path / "a.csv").write_text("time_s,stretch,nominal_stress_Pa\n0,1,0\n1,0.9,-90\n2,0.8,-200\n", encoding="utf-8")
    text = 'format = "explicitfe-dataset/1"\nname = "one"\ntitle = "x"\ntest = "compression"\n[specimen]\nshape = "point"\n'
    (tmp_path / "dataset.toml").write_text(text + '[noise]\n[[curve]]\nid = "a"\nfile = "a.csv"\n', encoding="utf-8")
    dataset = read_dataset(tmp_path)
    report = new_report(dataset, Split(dataset.curves, (), {}, "all"), "Pa")
    again = LoopReport.model_validate_json(report.text)
    assert again == report
    assert {name: (row.value, row.unit) for name, row in again.thresholds.items()} == {
        name: (value, unit) for name, value, unit, _ in entries()
    }
