"""What commands answer can be read by attributes and, as the file, by keys."""

from __future__ import annotations

import json

from explicitfe.results.documents.loop_report import LoopReport
from explicitfe.results.documents.planned_test import PlannedTest


def test_a_document_reads_like_its_file():
    file = {"dataset": "gel", "verdict": "unexplained", "final": {"error": {"fit": {"nrmse": 0.1}}}}
    report = LoopReport.model_validate(file)
    assert report.verdict == report["verdict"] == "unexplained"
    assert report["final"]["error"]["fit"]["nrmse"] == 0.1
    assert dict(report) == file == json.loads(report.text)
    assert "sentence" not in report
    assert report.get("sentence", "none") == "none"


def test_a_key_that_is_missing_is_no_key():
    planned = PlannedTest(protocol="p", file="f", n_eff=1.0, constants={}, effects=[], runs=0)
    assert list(planned.keys()) == ["protocol", "file", "n_eff", "constants", "effects", "runs"]
