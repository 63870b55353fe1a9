"""The report of a closed loop: complete for every verdict, safe with any text, whole without the network.

The reports are made up, but shaped like the real ones: ramp and hold of muscle at three rates, indentation there and back, force
steps. The models before and after are closed forms; what is measured is one of them plus noise from a seed.
"""

from __future__ import annotations

import copy
import io
import json
import re
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from explicitfe.app.view.page.close_loop import pictures
from explicitfe.app.view.page.close_loop.axis import goes_one_way
from explicitfe.app.view.page.close_loop.page import html, loop_charts, write
from explicitfe.app.view.page.close_loop.reading import drawn_curves
from explicitfe.app.view.page.words import chance, with_interval
from explicitfe.app.view.terminal.close_loop import loop_tables
from explicitfe.results.documents.loop_report import Estimate, LoopReport, ReportCurve, ReportedCause
from explicitfe.results.documents.verdict_text import details, headline, named_forms, probability, sentence, strength

TITLES = {
    "viscoelastic": "viscoelastic relaxation",
    "softening": "softening by past load (Mullins)",
    "friction": "friction of the tool",
    "third-yeoh": "third Yeoh term",
    "drainage": "drainage",
    "contact-offset": "offset of the contact point",
    "base-slip": "base that slips",
}
UNTESTABLE = {
    "friction": "a homogeneous state has no tool",
    "base-slip": "a homogeneous state has no base",
    "softening": "needs reloading: every specimen was loaded once",
    "adhesion": "needs a pull-off",
    "activation-lag": "needs an active muscle",
}


def holds() -> list[dict[str, Any]]:
    """Muscle in compression, stress over time: the ramp takes 6 to 17 % of 300 s, and the stress relaxes by two thirds."""
    rng, curves = np.random.default_rng(1), []
    cases = [(0.3, 0.05, "holdout"), (0.3, 0.01, "fit"), (0.3, 0.005, "fit"), (0.2, 0.01, "holdout"), (0.1, 0.01, "fit")]
    for direction, stiffness in (("cross-fibre", 1.0), ("fibre", 0.6)):
        for strain, rate, split in cases:
            ramp = strain / rate
            time = np.unique(np.concatenate([np.linspace(0.0, ramp, 12), ramp + np.geomspace(0.5, 295.0, 36)]))
            imposed = np.minimum(time * rate, strain)
            elastic = -stiffness * (2500.0 * imposed + 60000.0 * imposed**3)
            course = 0.35 + 0.65 * np.exp(-np.maximum(time - ramp, 0.0) / 25.0)
            after = elastic * np.where(time < ramp, 1.0 - 0.004 * time, course * (1.0 - 0.004 * ramp))
            measured = after + rng.normal(0.0, 12.0, len(time))
            curves.append(
                {
                    "id": f"{direction}-max-{strain}-rate-{rate}",
                    "split": split,
                    "x_label": "stretch",
                    "y_label": "nominal stress (Pa)",
                    "time_s": time,
                    "x": 1.0 - imposed,
                    "measured": measured,
                    "before": 0.52 * elastic,
                    "after": after,
                    "sd": np.full(len(time), 15.4),
                }
            )
    return curves


def loops(count: int = 2) -> list[dict[str, Any]]:
    """Indentation there and back twice: force over time, as 1 200 rows."""
    rng, curves = np.random.default_rng(2), []
    for number in range(count):
        time = np.linspace(0.0, 120.0, 1200)
        depth = (5.0 + number % 4) * np.abs(np.interp(time % 60.0, [0.0, 30.0, 60.0], [0.0, 1.0, 0.0]))
        before = 0.02 * depth + 0.004 * depth**2
        after = before * np.where(time % 60.0 < 30.0, 1.12, 0.86) * np.where(time < 30.0, 1.06, 0.98)
        curves.append(
            {
                "id": f"p{number // 4 + 1:03d}-cycle-{number % 4 + 1}",
                "split": "holdout" if number % 3 == 1 else "fit",
                "x_label": "displacement (mm)",
                "y_label": "force (N)",
                "time_s": list(time),
                "x": list(depth),
                "measured": list(after + rng.normal(0.0, 0.004, len(time))),
                "before": list(before),
                "after": list(after),
                "sd": [0.004] * len(time),
            }
        )
    return curves


def ramps() -> list[dict[str, Any]]:
    """Eight force steps upwards: displacement over force, no noise stated, the elastic model fits."""
    rng, curves = np.random.default_rng(3), []
    for name, split in (("block-a", "fit"), ("block-b", "holdout"), ("block-c", "fit")):
        force = np.linspace(0.1, 0.8, 8)
        model = 4.2 * force**0.8
        row = {"id": name, "split": split, "x_label": "force (N)", "y_label": "displacement (mm)", "time_s": 30.0 * np.arange(8)}
        noise = rng.normal(0.0, 0.03, 8)
        curves.append(row | {"x": force, "measured": model + noise, "before": model, "after": model, "sd": None})
    return curves


def error(curves: list[dict[str, Any]], key: str, floor: float = 0.008) -> dict[str, Any]:
    rows = {}
    for curve in curves:
        measured, model = np.asarray(curve["measured"]), np.asarray(curve[key])
        rmse = float(np.sqrt(np.mean((measured - model) ** 2)))
        rows[curve["id"]] = {"split": curve["split"], "rmse": rmse, "nrmse": rmse / float(np.abs(measured).max()), "floor": floor}

    def mean(side: str) -> dict[str, float] | None:
        part = [row for row in rows.values() if row["split"] == side]
        return {k: float(np.mean([row[k] for row in part])) for k in ("nrmse", "rmse")} if part else None

    return {"fit": mean("fit"), "holdout": mean("holdout"), "curves": rows}


def cause(probability: float, title: str = "", **more: Any) -> dict[str, Any]:
    decision = "present" if probability >= 0.9 else "undecided" if probability > 0.1 else "absent"
    return {"title": title, "decision": decision, "probability": probability, "forms": {}} | more


def hypothesis(p: float, decrease: float | None, *effects: str, **more: Any) -> dict[str, Any]:
    chi2 = None if decrease is None else 30000.0 - decrease
    numbers = {"probability": p, "fitted": decrease is not None, "chi2": chi2, "decrease": decrease}
    return {"causes": list(effects), "effects": list(effects), "parameters": {}, "reason": "", "bound": None} | numbers | more


def base(curves: list[dict[str, Any]], unit: str, **more: Any) -> dict[str, Any]:
    sides = {side: [c["id"] for c in curves if c["split"] == side] for side in ("fit", "holdout")}
    constants = {
        "C10_Pa": {"all": {"value": 1237.4, "ci95": [1180.2, 1301.9]}},
        "C20_Pa": {"all": {"value": 311.0, "ci95": [250.3, 371.0]}},
    }
    rows = []
    for curve in curves:
        sd, n = 0.03 if curve["sd"] is None else float(curve["sd"][0]), len(curve["x"])
        rows.append({"curve": curve["id"], "sd": sd, "rho": 0.91, "stated": False, "n": n, "n_eff": max(0.047 * n, 4.6)})
    return {
        "effect_titles": TITLES,
        "effects": [],
        "ambiguous_with": [],
        "remainder_where": "",
        "unit": unit,
        "n_eff": sum(row["n_eff"] for row in rows if row["curve"] in sides["fit"]),
        "split": sides
        | {"left_out": {}, "rule": "Of every protocol that has a repeat, one curve is held out; extremes stay in the fit."},
        "noise": {
            "rows": rows,
            "scale_sd": 0.012,
            "offset_sd": 0.0021,
            "numerical": [
                {"what": "a finer mesh", "share_of_noise": 0.21},
                {"what": "half the increment", "share_of_noise": 0.04},
            ],
            "text": "Noise was estimated from the residual of a smooth curve: first-order autoregressive rows.",
        },
        "baseline": {"parameters": constants, "error": error(curves, "before")},
        "final": {"parameters": constants, "error": error(curves, "after")},
        "causes": {name: {"title": name, "decision": "not-testable", "reason": why} for name, why in UNTESTABLE.items()},
        "hypotheses": [],
        "compared": 412,
        "fitted": 63,
        "lack_of_fit": {"chi2": 31.2, "free": 29, "p": 0.36},
        "discrepancy": 0.12,
        "posterior": {},
        "thresholds": {"decisive_probability": {"value": 0.9, "unit": "probability"}},
        "next_experiment": None,
        "sensitivity_to_assumed": {},
        "warnings": [],
        "provenance": {
            "explicitfe": "0.1.0",
            "python": "3.12",
            "date": "2024-05-13",
            "command": "explicitfe close-loop data",
            "sha256": {"a.csv": "9f2c"},
        },
    } | more


def one_effect() -> tuple[dict[str, Any], list[dict[str, Any]]]:
    curves = holds()
    visco = {"g": {"value": 0.652, "ci95": [0.631, 0.670]}, "tau_s": {"value": 24.8, "ci95": [22.9, 26.9]}}
    outcome = {"verdict": "effect-found", "effects": ["viscoelastic"], "error_fit": 0.0103}
    constants = {g: {"value": v, "ci95": [v - 31.0, v + 29.0]} for g, v in (("cross-fibre", 2412.0), ("fibre", 1466.0))}
    forms = {"viscoelastic + viscoelastic": 0.95, "power-law": 0.04}
    strength = {"parameter": "viscoelastic.g", "detectable": 0.031, "detectable_share": 0.034}
    report = base(
        curves,
        "Pa",
        dataset="muscle-compression",
        title="Fresh porcine skeletal muscle, unconfined uniaxial compression ramp and hold, two directions, three rates, "
        "three strains",
        verdict="effect-found",
        remainder="at-floor",
        effects=["viscoelastic"],
        sure=0.91,
        something_else=0.012,
        posterior={"viscoelastic": 0.92, "drainage + viscoelastic": 0.05, "other": 0.008, "nothing": 0.002},
        hypotheses=[
            hypothesis(0.91, 29719.0, "viscoelastic", "viscoelastic", parameters={"viscoelastic.g": 0.65}),
            hypothesis(0.04, 29709.0, "power-law"),
            hypothesis(0.0001, None, "drainage", bound=310.0),
            hypothesis(0.0, None, "third-yeoh", reason="the optimiser stopped at its bound"),
            hypothesis(0.0, 0.0),
        ],
        next_experiment={"protocol": "the same ramp ten times faster", "separates": ["viscoelastic", "other"], "minutes": 12.0},
        sensitivity_to_assumed={
            "specimen.density_kg_m3": [
                outcome | {"value": v, "parameters": {"C10_Pa": {"cross-fibre": {"value": 2412.0 + v / 100.0}, "fibre": 1466.0}}}
                for v in (1060.0, 900.0, 1200.0)
            ]
        },
    )
    report["causes"] = {
        "viscoelastic": cause(0.99, "relaxation", forms=forms, **strength),
        "drainage": cause(0.05, "drainage", parameter="drainage.share", detectable=0.21, detectable_share=0.21),
        "third-yeoh": cause(0.01, "third Yeoh term", parameter="third-yeoh.C30_Pa", detectable=45.0, detectable_share=0.08),
        **report["causes"],
    }
    report["split"]["left_out"] = {"cross-fibre-max-0.3-rate-0.01-digit2": "a second digitisation of a curve in the fit"}
    report["baseline"]["parameters"] = {"C10_Pa": constants, "C20_Pa": constants}
    report["final"]["parameters"] = report["baseline"]["parameters"] | {f"viscoelastic.{k}": v for k, v in visco.items()}
    return report, curves


def ambiguous(count: int = 20) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    curves = loops(count)
    assumed = {
        "tool.radius_mm": (4.5, 5.0, 5.5),
        "specimen.radius_mm": (40.0, 50.0, 60.0),
        "specimen.base": ("bonded", "frictionless"),
    }

    def row(key: str, value: Any, number: int) -> dict[str, Any]:
        other = key == "specimen.base" and number == 1
        scale = 1.0 + 0.13 * (number - 1) * (-1.0 if key == "tool.radius_mm" else 0.4)
        parameters = {"C10_Pa": {"all": {"value": 1237.4 * scale}}, "C20_Pa": {"all": {"value": 311.0 * scale**3}}}
        outcome = ("effect-found", ["base-slip"]) if other else ("ambiguous", ["friction"])
        judged = dict(zip(("verdict", "effects"), outcome, strict=True))
        return {"value": value, "parameters": parameters, "error_fit": 0.011 + 0.002 * number} | judged

    following = {"protocol": "the same depth with a ball of 10 mm, three cycles", "separates": ["friction", "softening"]}
    strength = {"parameter": "stiffness-gradient.g", "detectable": -0.16, "detectable_share": 0.22}
    report = base(
        curves,
        "N",
        dataset="silicone-indentation",
        title="Soft silicone blocks indented with a ball to 5-10 mm: ramp, hold, fast retraction",
        verdict="ambiguous",
        remainder="ambiguous",
        remainder_where="The misfit lies mostly early in the first unloading.",
        effects=["friction"],
        ambiguous_with=["friction", "softening", "stiffness-gradient"],
        credible=["friction", "softening", "friction + stiffness-gradient", "stiffness-gradient", "nothing"],
        posterior={
            "friction": 0.38,
            "softening": 0.31,
            "friction + stiffness-gradient": 0.14,
            "stiffness-gradient": 0.09,
            "nothing": 0.03,
            "other": 0.01,
        },
        something_else=0.02,
        sure=0.96,
        hypotheses=[
            hypothesis(0.38, 410.0, "friction", parameters={"friction.coefficient": 0.42}),
            hypothesis(0.31, 412.0, "softening", parameters={"softening.r": 2.1, "softening.m_Pa": 210.0}),
            hypothesis(0.08, 409.0, "friction", "layer"),
        ],
        next_experiment=following | {"separation": 140.0, "information_bits": 0.83, "minutes": 9.0, "repeats": 3},
        proposed_tests=[following | {"information_bits": 0.83}, following | {"protocol": "a hold", "information_bits": 0.4}],
        sensitivity_to_assumed={key: [row(key, v, k) for k, v in enumerate(values)] for key, values in assumed.items()},
        warnings=["Repeats scatter by 3 %, three times the noise of a row.", "The tool's radius is assumed."],
    )
    report["causes"] = {
        "friction": cause(0.53, "friction of the tool"),
        "softening": cause(0.33, "softening by past load (Mullins)", forms={"softening": 0.31, "payne": 0.02}),
        "stiffness-gradient": cause(
            0.23, "stiffness that changes with depth", forms={"layer": 0.15, "inclusion": 0.08}, **strength
        ),
        "contact-offset": cause(0.02, "offset of the contact point"),
        "viscoelastic": {"title": "relaxation", "decision": "not-testable", "reason": "requires several rates"},
    }
    return report, curves


def unexplained() -> tuple[dict[str, Any], list[dict[str, Any]]]:
    curves = [curve | {"after": curve["before"]} for curve in loops(6)]
    report = base(
        curves,
        "N",
        dataset="loops",
        title="Six loops",
        verdict="unexplained",
        remainder="unexplained",
        remainder_where="the misfit lies in unloading, late and at low load, in all curves",
        nearest=["friction", "softening"],
        posterior={"friction + softening": 0.97, "softening": 0.02, "nothing": 0.01},
        something_else=0.97,
        sure=0.97,
        lack_of_fit={"chi2": 5021.0, "free": 29, "p": 1e-80},
        discrepancy=4.2,
        hypotheses=[hypothesis(0.97, 5400.0, "friction", "softening")],
    )
    report["causes"] = {name: cause(p, TITLES[name]) for name, p in (("softening", 0.99), ("friction", 0.97), ("drainage", 0.0))}
    return report, curves


def nothing(verdict: str = "no-missing-effect") -> tuple[dict[str, Any], list[dict[str, Any]]]:
    curves = ramps()
    head = {"dataset": "blocks", "title": "Three blocks", "verdict": verdict, "remainder": "at-floor"}
    posterior = {"nothing": 0.953, "contact-offset": 0.02, "compliance": 0.01, "other": 0.002}
    report = base(curves, "mm", posterior=posterior, something_else=0.002, sure=0.953, **head)
    strengths = [
        ("third-yeoh", "C30_Pa", 599.0, 1.0),
        ("compliance", "compliance_mm_N", 0.204, 0.09),
        ("viscoelastic", "g", 0.0312, 0.034),
        ("contact-offset", "offset_mm", 0.31, 0.5),
        ("drainage", "share", 0.12, 0.12),
        ("base-slip", "compliance_mm_kPa", 22.1, 0.2),
        ("compressible", "poisson", 0.4913, 0.3),
    ]
    report["causes"] = {
        name: cause(0.02, TITLES.get(name, ""), parameter=f"{name}.{key}", detectable=value, detectable_share=share)
        for name, key, value, share in strengths
    }
    report["hypotheses"] = [hypothesis(0.953, 0.0)]
    return report, curves


def limited() -> tuple[dict[str, Any], list[dict[str, Any]]]:
    report, curves = nothing("limited-by-numerics")
    report["noise"]["numerical"] = [
        {"what": "assumed radius_mm", "share_of_noise": 0.9},
        {"what": "mesh", "share_of_noise": 0.62},
    ]
    return report, curves


def failed() -> tuple[dict[str, Any], list[dict[str, Any]]]:
    curves = [curve | {"after": None, "split": "fit"} for curve in ramps()[:1]]
    report = base(
        [curve | {"after": curve["before"]} for curve in curves],
        "mm",
        dataset="blocks",
        verdict="failed",
        remainder=None,
        message="C20 is at its upper bound (1 MPa): these data do not determine it. Apply a larger load.",
    )
    report["final"] = None
    return report, curves


@pytest.fixture(autouse=True, scope="module")
def coarse_figures():
    """Few dots in the figures: drawing them is most of the time here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures, "PAGE_DOTS_PER_INCH", 30)
        yield


BUILDERS = {
    "effect-found": one_effect,
    "ambiguous": ambiguous,
    "unexplained": unexplained,
    "no-missing-effect": nothing,
    "limited-by-numerics": limited,
    "failed": failed,
}
NOTHING_SHOWN = "Nothing is missing that these data could show (probability 0.95)"
DETECTABLE = (
    "Detectable: viscoelastic relaxation from g = 0.031, compliance from 0.2 mm/N, drainage from share = 0.12, "
    "base that slips from 22 mm/kPa, compressible from poisson = 0.49."
)
HEADLINES = {
    "effect-found": ("The model lacks relaxation (probability 0.99)", "Best form: two Prony terms (probability 0.95)."),
    "ambiguous": (
        "Ambiguous cause: friction of the tool (0.38), softening by past load (Mullins) (0.31) or one of 4 other sets",
        "6 sets of causes hold 95 % together",
    ),
    "unexplained": (
        "Something is missing that no candidate describes (probability 0.97)",
        "Friction of the tool and softening by past load (Mullins) explain part of the residual (probability 0.97).",
    ),
    "no-missing-effect": (NOTHING_SHOWN, DETECTABLE),
    "limited-by-numerics": (NOTHING_SHOWN, "Its largest part is 0.62 times the noise (mesh)."),
    "failed": ("The fit failed", "C20 is at its upper bound"),
}


@pytest.fixture(scope="module", params=list(BUILDERS))
def written(request, tmp_path_factory) -> tuple[str, dict[str, Any], Path, list[str]]:
    folder = tmp_path_factory.mktemp("report")
    report, curves = BUILDERS[request.param]()
    return request.param, report, folder, write(folder, *typed(report, curves))


def typed(report: dict[str, Any], curves: list[dict[str, Any]]) -> tuple[LoopReport, list[ReportCurve]]:
    """As the page takes them."""
    return LoopReport.model_validate(report), [ReportCurve(**curve) for curve in curves]


def page_of(report: dict[str, Any], curves: list[dict[str, Any]]) -> str:
    """The page."""
    document, columns = typed(report, curves)
    rows = drawn_curves(columns)
    return html(document, rows, loop_charts(document, rows))


def drawn(curves: list[dict[str, Any]]) -> list[ReportCurve]:
    return drawn_curves([ReportCurve(**curve) for curve in curves])


def words(page: str) -> str:
    """What a reader reads."""
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", re.sub(r"<style>.*?</style>", "", page, flags=re.DOTALL)))


def test_all_files_are_there(written):
    _, report, folder, names = written
    expected = ["report.html", "causes.png", "before-after.png", "residuals.png"]
    assert names == expected + (["sensitivity.png"] if report["sensitivity_to_assumed"] else [])
    assert sorted(path.name for path in folder.iterdir()) == sorted(names)
    assert all((folder / name).read_bytes().startswith(b"\x89PNG") for name in names[1:])


def test_the_page_is_whole_by_itself(written):
    """Every reference is to the page itself, and nothing runs."""
    page = (written[2] / "report.html").read_text(encoding="utf-8")
    assert all(target.startswith(("data:image/png;base64,", "#")) for target in re.findall(r'(?:src|href)="([^"]*)', page))
    assert not re.search(r"https?:|<script|<link|@import|url\(|<iframe", page)
    for target in re.findall(r'href="#([^"]*)', page):
        assert f'id="{target}"' in page


def test_the_headline_is_the_same_everywhere(written):
    """Page, terminal and the sentence of the document; no details are lost on the way."""
    verdict, report, folder, _ = written
    document = LoopReport.model_validate(report)
    head, part = HEADLINES[verdict]
    page = unescape((folder / "report.html").read_text(encoding="utf-8"))
    assert headline(document) == head and part in details(document)
    assert f">{head}</h1>" in page and details(document) in words(page)
    assert sentence(document) in " ".join(printed(loop_tables(document)).replace("│", " ").split())


def test_the_probability_of_the_headline_is_that_of_all_its_causes_together():
    """Sets with a further cause count: the model lacks both all the same."""
    posterior = {"softening + viscoelastic": 0.80, "drainage + softening + viscoelastic": 0.13, "viscoelastic": 0.07}
    causes = {name: cause(0.93, TITLES[name]) for name in ("viscoelastic", "softening")} | {"drainage": cause(0.13)}
    report = {"verdict": "effect-found", "sure": 0.8, "posterior": posterior, "causes": causes, "ambiguous_with": ["drainage"]}
    document = LoopReport.model_validate(report)
    both = "viscoelastic relaxation and softening by past load (Mullins)"
    assert headline(document) == f"The model lacks {both} (probability 0.93)"
    assert details(document) == "Not decided: drainage (0.13)."


def test_the_headline_of_a_search_that_was_cut_off_says_so():
    report = {"verdict": "effect-found", "effects": ["tilt"], "causes": {"tilt": cause(0.997)}, "fitted": 45, "compared": 98}
    found = "The model lacks tilt (probability > 0.99"
    assert headline(LoopReport.model_validate(report)) == f"{found})"
    among = "among the 45 of 98 hypotheses that were fitted before the limit"
    assert headline(LoopReport.model_validate(report | {"cut_off": True})) == f"{found} {among})"
    nothing = LoopReport(verdict="no-missing-effect", cut_off=True, fitted=45, compared=98)  # it has no probability of its own
    assert headline(nothing) == f"Nothing is missing that these data could show ({among})"


def test_few_sets_are_all_in_the_headline():
    posterior = {"drainage": 0.6, "nothing": 0.3, "other": 0.06, "tilt": 0.04}
    document = LoopReport.model_validate({"verdict": "ambiguous", "credible": ["drainage", "nothing"], "posterior": posterior})
    listed = "drainage (0.60), no missing effect (0.30) or something that no candidate describes (0.06)"
    assert headline(document) == f"Ambiguous cause: {listed}"
    assert details(document) == "These data do not distinguish the causes."


@pytest.mark.parametrize(
    ("forms", "text"),
    [
        ({"viscoelastic + viscoelastic": 0.9, "viscoelastic": 0.05}, ["two Prony terms", "one Prony term"]),
        ({"power-law + viscoelastic": 0.9}, ["power law and one Prony term"]),
        ({"softening + softening": 0.9}, ["two terms of softening by past load (Mullins)"]),
        ({"drainage": 0.9}, []),
    ],
)
def test_names_of_forms(forms, text):
    """The only form of a cause that is called as the cause itself is not repeated."""
    document = LoopReport.model_validate({"causes": {"drainage": cause(0.9, "drainage", forms=forms)}, "effect_titles": TITLES})
    assert list(named_forms(document, "drainage")) == text


def test_the_best_form_names_its_cause_beside_others():
    forms = {"viscoelastic + viscoelastic": 0.9}
    causes = {"viscoelastic": cause(0.99, "relaxation", forms=forms), "drainage": cause(0.99)}
    document = LoopReport.model_validate({"verdict": "effect-found", "causes": causes})
    assert details(document) == "Best form of relaxation: two Prony terms (probability 0.90)."


@pytest.mark.parametrize(
    ("parameter", "value", "text"),
    [
        ("third-yeoh.C30_Pa", 599.0, "600 Pa"),
        ("compliance.compliance_per_kPa", 0.0224, "0.022/kPa"),
        ("compressible.poisson", 0.4913, "poisson = 0.49"),
        ("force-drift.rate_N_s", -0.000401, "-0.0004 N/s"),
    ],
)
def test_strengths_in_words(parameter, value, text):
    assert strength(ReportedCause(parameter=parameter, detectable=value)) == text
    assert strength(ReportedCause(parameter=parameter)) == ""


def test_probabilities_close_to_certainty_are_bounds():
    assert [probability(p) for p in (1.0, 0.996, 0.994, 0.5, 0.006, 0.004)] == ["> 0.99"] * 2 + ["0.99", "0.50", "0.01", "< 0.01"]


def test_a_document_without_probabilities():
    assert headline(LoopReport(verdict="effect-found", effects=["tilt", "base-slip"])) == "The model lacks tilt and base slip"
    assert headline(LoopReport(verdict="ambiguous")) == "Ambiguous cause"
    assert headline(LoopReport(verdict="unexplained")) == "Something is missing that no candidate describes"
    assert details(LoopReport(verdict="no-missing-effect")) == ""


def test_hypotheses_causes_and_the_next_test_on_the_page():
    text = words(page_of(*one_effect())).replace("\u00a0", " ")
    assert "relaxation 0.99 present two Prony terms 0.95, power law 0.04 g = 0.031 3.4 %" in text
    assert "two Prony terms 0.91 fitted 29 700" in text
    assert "drainage &lt; 0.01 screened – 310" in text
    assert "could not be computed" in text and "the optimiser stopped at its bound" in text
    assert "The smooth misfit that remains after the fit is 0.12 times the noise (χ² = 31.2 for 29 functions, p = 0.36)." in text
    assert 'The same ramp ten times faster. Separates "relaxation" from "something that no candidate describes".' in unescape(
        text
    )


def test_bars_of_the_picture():
    """A bar for each tested cause, something else and nothing; parts of a bar are the probabilities of the forms."""
    document, _ = typed(*one_effect())
    (axes,) = pictures.causes_figure(document).axes
    titles = [label.get_text() for label in axes.get_yticklabels()]
    assert titles == ["relaxation", "drainage", "third Yeoh term", "something else", "nothing is missing"]
    widths = [bar.get_width() for bar in axes.patches if bar.get_y() < 0.0 < bar.get_y() + bar.get_height()]
    assert widths[:3] == pytest.approx([0.99, 0.95, 0.04])
    assert [line.get_xdata()[0] for line in axes.lines] == pytest.approx([0.1, 0.9])


def test_numbers_on_the_page():
    """The errors of the held-out curves, the floor, the interval's digits and the number of independent data."""
    report, curves = one_effect()
    report["baseline"]["error"]["holdout"] = {"nrmse": 0.2137, "rmse": 512.0}
    report["final"]["error"]["holdout"] = {"nrmse": 0.01362, "rmse": 31.0}
    text = words(page_of(report, curves)).replace("\u00a0", " ")
    assert "Error on 4 held-out curves whole curves that the fit did not see 21 % before: elastic model 1.4 % after" in text
    assert "Floor 0.80 %" in text
    assert "512" not in text and "510 → 31 Pa root mean square" in text
    assert "28 independent data in 288 rows" in text
    assert "viscoelastic relaxation: tau (s) – 24.8 (22.9 to 26.9)" in text
    assert "friction a homogeneous state has no tool" in text.replace("  ", " ")


def test_without_hold_out_the_page_says_so():
    report, curves = failed()
    text = words(page_of(report, curves))
    assert "Error on 1 fitted curve" in text and "no curve was held out" in text


def test_hostile_text_is_text(tmp_path):
    """Whatever stands in a text arrives as text, in the page and in the figures."""
    evil = '<script>alert("$x_1$")</script>&<img src="http://a.b/c">\\frac{'

    def poison(value: Any, key: str = "") -> Any:
        if isinstance(value, dict):
            return {(k if k in KEYS else f"{k}{evil}"): poison(v, k) for k, v in value.items()}
        if isinstance(value, list):
            return [poison(inner, key) for inner in value]
        return f"{value}{evil}" if isinstance(value, str) and key not in ("decision", "verdict", "remainder", "split") else value

    report, curves = ambiguous(2)
    KEYS = set(re.findall(r'"(\w+)":', json.dumps(report))) - {"sha256"}
    report = poison(report)
    curves = [curve | {k: f"{curve[k]}{evil}" for k in ("id", "x_label", "y_label")} for curve in curves]
    write(tmp_path, *typed(report, curves))
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<script" not in page and '<img src="http' not in page and "alert(&#34;" in page
    assert "<img " not in page and page.count("<figure") == page.count("</figure>") > 4


@pytest.mark.parametrize("null", [False, True])
def test_any_key_may_be_missing(null):
    """Every key in turn left out, or null, down to the fifth level, in the page and in the figures that read it."""
    report, curves = ambiguous(1)
    report["sensitivity_to_assumed"].popitem()
    light = [{k: v[::40] if isinstance(v, list) else v for k, v in curve.items()} for curve in curves]
    rows = drawn(light)
    for tree, top in leaving_out(report, null):
        document = LoopReport.model_validate(tree)
        assert "</html>" in html(document, rows, loop_charts(document, rows))
        if top in ("causes", "effect_titles", "posterior", "thresholds"):
            pictures.causes_figure(document)
        assert sentence(document) and loop_tables(document)


def leaving_out(tree: dict[str, Any], null: bool) -> Iterator[tuple[dict[str, Any], str]]:
    """Copies of a tree, each with one branch gone or null, and the key at the top above that branch; of lists the first entry."""

    def paths(node: Any, path: tuple[Any, ...]) -> Iterator[tuple[Any, ...]]:
        inner = node.items() if isinstance(node, dict) else enumerate(node[:1]) if isinstance(node, list) else ()
        for key, value in inner if len(path) < 5 else ():
            yield (*path, key)
            yield from paths(value, (*path, key))

    for *above, key in paths(tree, ()):
        other = copy.deepcopy(tree)
        parent: Any = other
        for step in above:
            parent = parent[step]
        if null:
            parent[key] = None
        else:
            del parent[key]
        yield other, [*above, key][0]


def test_any_column_may_be_missing():
    report, curves = ambiguous(2)
    document = LoopReport.model_validate(report)
    light = [{k: v[::40] if isinstance(v, list) else v for k, v in curve.items()} for curve in curves]
    for key in light[0]:
        rows = drawn([{k: v for k, v in light[0].items() if k != key}, light[1] | {key: None}])
        assert len(rows) == (0 if key == "measured" else 2)
        charts = loop_charts(document, rows)
        pictures.figure_of(charts.residuals, 2)
        assert len(charts.curves) == len(rows) and "</html>" in html(document, rows, charts)


def test_next_to_nothing_is_enough(tmp_path):
    """No key, no curve, curves of NaN and of zeros."""
    assert len(write(tmp_path, LoopReport(), [])) == 4
    rows = [{"id": "a", "measured": [1.0, None, 3.0]}, {"measured": [0.0, 0.0], "before": [0.0, float("nan")]}, {"id": "b"}, {}]
    assert len(write(tmp_path, LoopReport(verdict="effect-found"), [ReportCurve(**row) for row in rows])) == 4


def test_an_axis_is_the_imposed_quantity_unless_it_turns_back_or_is_held():
    time, up = np.linspace(0.0, 300.0, 60), np.linspace(1.0, 0.7, 60)
    assert goes_one_way(time, up)
    assert not goes_one_way(time, np.concatenate([up[:30], up[29::-1]]))
    assert not goes_one_way(time, np.maximum(up, 0.8))


def test_an_effect_whose_strength_is_not_determined_is_named_with_this_remark():
    report, curves = one_effect()
    report["undetermined"] = {"viscoelastic.g": "its interval includes zero effect"}
    report["strength_undetermined"] = ["viscoelastic"]
    text = words(page_of(report, curves))
    assert "The strength of viscoelastic relaxation is not determined." in text
    assert "not determined: its interval includes zero effect" in text
    assert "not determined" not in words(page_of(*one_effect()))


@pytest.mark.parametrize(
    ("p", "is_bound", "text"),
    [
        (3.0 / 20001.0, True, "< 0.00015"),
        (3.0 / 20001.0, False, "1.5·10⁻⁴"),
        (1.0 / 20001.0, True, "< 0.0001"),
        (7.01e-4, True, "< 0.00071"),
        (1.0, True, "1.0"),
        (None, True, "–"),
    ],
)
def test_a_bound_of_a_p_value_is_no_value(p, is_bound, text):
    """Of 20 000 draws none reached the drop: p is then no larger than one in 20 001, times the number of candidates."""
    assert chance(p, is_bound) == text


def test_the_terminal_and_the_page_say_the_same_of_a_cause():
    """Probability, forms and the smallest detectable strength."""
    report, curves = one_effect()
    page = unescape(words(page_of(report, curves)))
    terminal = printed(loop_tables(LoopReport.model_validate(report))).replace("\u00a0", " ")
    for text in ("two Prony terms 0.95, power law 0.04", "g = 0.031", "share = 0.21", "0.652 (0.631 to 0.670)", "27 %"):
        assert text in page and text in terminal


def printed(table: Any) -> str:
    console = Console(width=240, file=io.StringIO())
    console.print(table)
    return console.file.getvalue()


def test_intervals_are_rounded_to_their_width():
    assert with_interval(Estimate(value=1237.4, ci95=[1180.2, 1301.9])) == "1\u00a0240 (1\u00a0180 to 1\u00a0300)"
    assert with_interval(Estimate(value=0.65213, ci95=[0.6318, 0.6704])) == "0.652 (0.632 to 0.670)"
    assert with_interval(Estimate(value=3.0)) == "3.00"
    assert with_interval(None) == "–"
