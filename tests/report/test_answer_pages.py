"""The pages of predict, identify and design-test: each number where a reader looks for it, and no text that does harm."""

from __future__ import annotations

import json
import re
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import command
from identify_cases import write_homogeneous

from explicitfe.app.view.page.curves import MOST_CURVES
from explicitfe.app.view.page.design import design_page
from explicitfe.app.view.page.predict import predict_page
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import point
from explicitfe.results.documents.planned_test import EffectInTest, PlannedTest
from explicitfe.results.documents.prediction import PredictedCurve, PredictedRows, Prediction, PredictionError

EVIL = "</style><script>alert(1)</script>"
MODEL = 'format = "explicitfe-model/1"\n[constants]\nC10_Pa = 500.0\nC20_Pa = 200.0\n'


def words(page: str) -> str:
    """What a reader sees, on one line."""
    body = re.sub(r"<(style|svg)[^>]*>.*?</\1>", " ", page, flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", body)).split())


def predicted(**changes: Any) -> PredictedCurve:
    x = np.linspace(0.0, 2.0, 9)
    rows = PredictedRows(time_s=x.tolist(), imposed=x.tolist(), measured=(2.0 * x).tolist(), predicted=(1.9 * x).tolist())
    given = {"status": "predicted", "split": "holdout", "constants": "all", "quantity": "force", "unit": "N"}
    given |= {"imposed": "displacement", "imposed_unit": "mm", "rows": rows, "rmse": 0.1, "nrmse": 0.025}
    return PredictedCurve(**given | changes)


def prediction(curves: dict[str, PredictedCurve], **changes: Any) -> Prediction:
    given: dict[str, Any] = {"dataset": "made", "model": "my model.toml", "effects": ["contact-offset"], "refinement": 1.0}
    given |= {"density": 1.0, "tolerance": 1e-4, "assumed": ["Poisson's ratio 0.499"], "wall_s": 3.0}
    given |= {"curves": curves, "error": {"holdout": PredictionError(curves=1, nrmse=0.025)}}
    return Prediction(**given | changes)


def test_a_prediction() -> None:
    failed = predicted(status="failed", message="it did not settle.", rmse=None, nrmse=None)
    page = predict_page(prediction({"one": predicted(), "two": failed}), "my data")
    text = words(page)
    for part in (
        "made, predicted with contact offset",
        "2.5 % of the largest value, on 1 held-out curve",
        "one, held out, error 2.5 %",
        "two it did not settle.",
        "explicitfe predict 'my data' --model 'my model.toml'",
        "displacement (mm)",
    ):
        assert part in text
    assert page.count('<figure class="chart"') == 2 and "script-src &#39;none&#39;" in page


def test_what_turns_back_is_drawn_over_time() -> None:
    back = predicted().rows.model_copy(update={"imposed": [0.0, 1.0, 2.0, 3.0, 4.0, 3.0, 2.0, 1.0, 0.0]})
    page = predict_page(prediction({"cycle": predicted(rows=back)}), "data")
    assert "time (s)" in words(page) and "displacement (mm)" not in words(page)


def test_of_many_curves_the_worst_are_drawn() -> None:
    curves = {f"c{number}": predicted(nrmse=0.01 * number) for number in range(MOST_CURVES + 5)}
    page = predict_page(prediction(curves), "data")
    assert page.count('<figure class="chart"') == MOST_CURVES and "the table below has 5 more" in words(page)
    assert "c28, held out" in words(page) and "c4, held out" not in words(page)


def test_a_plan() -> None:
    found = EffectInTest(effect="tilt", strength="tilt.angle_deg", unit="deg", shows=True, smallest=0.5, largest_plausible=2.0)
    found = found.model_copy(
        update={"nearest": "layer", "separation": 3e3, "cannot_tell_from": ["friction"], "hides_in": {"C10_Pa": 0.1}}
    )
    hidden = EffectInTest(effect="drainage", strength="drainage.k", shows=False, reason="it needs a hold")
    plan = PlannedTest(protocol=EVIL, file="a b.toml", n_eff=62.0, constants={"C10_Pa": 300.0}, effects=[found, hidden], runs=3)
    page = design_page(plan)
    text = words(page)
    for part in (
        "1 of 2 effects are detectable with 62 independent rows.",
        "angle (deg) 0.5 2",
        "C10 +10 %",
        "tilt friction layer 3 000",
    ):
        assert part in text.replace("\N{NO-BREAK SPACE}", " ")
    assert "drainage it needs a hold" in text and "explicitfe design-test 'a b.toml'" in text
    assert 'class="a" style="width: 25.0%"' in page and "<script" not in page


def test_the_commands_write_their_pages(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stretch = np.linspace(1.0, 0.8, 12)
    stress = point.uniaxial(Yeoh(C10_Pa=500.0, C20_Pa=200.0), (), np.zeros(len(stretch)), stretch)
    data = write_homogeneous(tmp_path / "data", "compression", "stretch,nominal_stress_Pa", stretch, stress, "stress_sd_Pa = 1.0")
    (tmp_path / "model.toml").write_text(MODEL, encoding="utf-8")
    for words_of_command, page, expected in (
        (
            ["identify", str(data), "--poisson", "0.499"],
            "identify.html",
            ["C10 500.0 Pa", "Profile likelihood", "C20 = 200 Pa, 95 %", "one, fitted, error"],
        ),
        (["predict", str(data), "--model", str(tmp_path / "model.toml")], "predict.html", ["by the elastic model", "< 0.01 %"]),
    ):
        out = tmp_path / words_of_command[0]
        assert command([*words_of_command, "--out", str(out), "--json"]) == 0
        assert str(out / page) in json.loads(capsys.readouterr().out)["files"]
        text = words((out / page).read_text(encoding="utf-8")).replace("\N{NO-BREAK SPACE}", " ")
        assert [part for part in expected if part not in text] == []
