"""Score answers against the truth of a set, and print one Markdown table with a column for each program.

    python score.py SET answers-a.json answers-b.json

README.md describes the format. Answers are judged by cause (causes.py). A case without an answer counts as failed.
Singles and pairs that are not identifiable are left out, unless --all is given.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from causes import causes_of
from scipy.stats import beta

FOUND, NOTHING, AMBIGUOUS = "effect-found", "no-missing-effect", "ambiguous"
SILENT = (NOTHING, "limited-by-numerics")
VERDICTS = (FOUND, AMBIGUOUS, "unexplained", *SILENT, "failed")
OTHER = "something-else"  # a cause that is in no library
BINS = (0.0, 0.5, 0.7, 0.9, 0.97, 1.0)
LEVEL = 0.95  # of the binomial intervals
FEWEST_IN_A_BIN = 5  # a bin with fewer cases is not judged

Answer = Mapping[str, Any]
Truth = Mapping[str, Any]


def read_answers(path: Path, names: Iterable[str]) -> dict[str, Answer]:
    """The answers of a program to the cases of a set.

    Raises
    ------
    ValueError : the file is not an entry; the message names the case and the key.
    """
    cases = json.loads(path.read_text(encoding="utf-8")).get("cases")
    if not isinstance(cases, dict):
        raise ValueError(f'{path}: the key "cases" is missing; see README.md for the format')
    for name, answer in cases.items():
        if answer.get("verdict") not in VERDICTS:
            raise ValueError(f"{path}: {name}: verdict = {answer.get('verdict')!r}; choose from {', '.join(VERDICTS)}")
        for entry in answer.get("probabilities", []):
            if not 0.0 <= entry["probability"] <= 1.0:
                raise ValueError(f"{path}: {name}: probability = {entry['probability']} is not between 0 and 1")
    return {name: cases.get(name, {"verdict": "failed"}) for name in names}


def outcome(answer: Answer, truth: Truth) -> str:
    """One word for an answer; the words of each kind of case are those of the rows of the table."""
    verdict = answer["verdict"]
    named = causes_of(answer.get("causes", ()))
    true = frozenset(truth["causes"])
    if verdict == "failed":
        return "failed"
    if truth["kind"] == "control":
        return "silent" if verdict in SILENT else "alarm"
    if verdict in SILENT:
        return "missed"
    if verdict == "unexplained":
        return "unexplained"
    if verdict == AMBIGUOUS:
        return "ambiguous, true named" if true and true <= _plausible(answer) else "ambiguous"
    if truth["kind"] == "outside":
        return "described" if named and named == frozenset(truth["accepts"]) else "confidently wrong"
    if named == true:
        return "right"
    return "one" if truth["kind"] == "pair" and named and named < true else "confidently wrong"


def _plausible(answer: Answer) -> frozenset[str]:
    """All causes that an ambiguous answer names."""
    sets = [entry["causes"] for entry in answer.get("probabilities", []) if entry["probability"] >= 1.0 - LEVEL]
    return causes_of([*answer.get("causes", ()), *(name for one in sets for name in one)])


# ---- probabilities and intervals ----


def most_probable(answer: Answer, truth: Truth) -> tuple[float, bool] | None:
    """Probability of the most probable set of causes, and whether the set is true; None where the answer states none."""
    entries = answer.get("probabilities", [])
    if not entries:
        return None
    top = max(entries, key=lambda entry: entry["probability"])
    named = causes_of(top["causes"])
    if truth["kind"] == "outside":
        right = named == frozenset(truth["accepts"]) if truth["accepts"] else named == frozenset({OTHER})
    else:
        right = named == frozenset(truth["causes"])
    return float(top["probability"]), right


def binomial_interval(hits: int, number: int) -> tuple[float, float]:
    """Interval of Clopper and Pearson (1934) for a share."""
    tail = 0.5 * (1.0 - LEVEL)
    low = 0.0 if hits == 0 else float(beta.ppf(tail, hits, number - hits + 1))
    high = 1.0 if hits == number else float(beta.ppf(1.0 - tail, hits + 1, number - hits))
    return low, high


def covered(answer: Answer, truth: Truth) -> list[bool]:
    """For each stated interval of a parameter of the true model, whether it holds the true value."""
    right = outcome(answer, truth) in ("right", "silent")
    if not right:
        return []
    hits = []
    for name, interval in answer.get("parameters", {}).items():
        effect, _, key = name.partition(".")
        true = truth.get(name) if not key else truth["parameters"].get(effect, {}).get(key)
        if isinstance(true, list):
            true = true[0] if len(true) == 1 else None
        if true is not None and None not in interval:
            hits.append(interval[0] <= true <= interval[1])
    return hits


# ---- the table ----


def column(answers: Mapping[str, Answer], truth: Mapping[str, Truth], everything: bool = False) -> dict[str, str]:
    """Row -> entry of one program."""
    words: dict[str, Counter[str]] = {}
    counted = {name: t for name, t in truth.items() if everything or t["identifiable"] is not False or t["kind"] == "outside"}
    for name, t in counted.items():
        group = t["kind"] if t["kind"] != "single" else f"single, {t['setting']}"
        words.setdefault(group, Counter())[outcome(answers[name], t)] += 1

    def share(group: str, *which: str) -> str:
        number = words.get(group, Counter()).total()
        return f"{sum(words[group][word] for word in which)}/{number}" if number else "-"

    rows = {
        "controls alarmed": share("control", "alarm"),
        "singles right, without a tool": share("single, homogeneous", "right"),
        "singles right, under a tool": share("single, tool", "right"),
        "singles ambiguous, true cause named": share_of(words, "single", "ambiguous, true named"),
        "singles confidently wrong": share_of(words, "single", "confidently wrong"),
        "singles missed": share_of(words, "single", "missed"),
        "pairs: both": share("pair", "right"),
        "pairs: one of them": share("pair", "one"),
        "pairs confidently wrong": share("pair", "confidently wrong"),
        "outside: described by its cause": share("outside", "described"),
        "outside confidently wrong": share("outside", "confidently wrong"),
        "failed": f"{sum(answers[name]['verdict'] == 'failed' for name in counted)}/{len(counted)}",
    }
    rows |= _reliability(answers, counted)
    hits = [hit for name, t in counted.items() for hit in covered(answers[name], t)]
    rows["95 % intervals that cover"] = f"{sum(hits)}/{len(hits)} ({100.0 * np.mean(hits):.0f} %)" if hits else "-"
    seconds = [float(answers[name]["seconds"]) for name in counted if answers[name].get("seconds") is not None]
    rows["seconds, median (largest)"] = f"{np.median(seconds):.3g} ({max(seconds):.3g})" if seconds else "-"
    return rows


def share_of(words: Mapping[str, Counter[str]], kind: str, word: str) -> str:
    """The share of a word among all groups of a kind."""
    groups = [counter for group, counter in words.items() if group.startswith(kind)]
    number = sum(counter.total() for counter in groups)
    return f"{sum(counter[word] for counter in groups)}/{number}" if number else "-"


def _reliability(answers: Mapping[str, Answer], truth: Mapping[str, Truth]) -> dict[str, str]:
    """Row -> cases of a bin of the probability that are right, and whether the stated probability is in their interval."""
    tops = [top for name, t in truth.items() if (top := most_probable(answers[name], t)) is not None]
    rows = {}
    for low, high in pairwise(BINS):
        inside = [(p, right) for p, right in tops if low <= p < high or (high == 1.0 and p == 1.0)]
        label = f"right where the probability is {low:g} to {high:g}"
        if not inside:
            rows[label] = "-"
            continue
        hits = sum(right for _, right in inside)
        a, b = binomial_interval(hits, len(inside))
        stated = float(np.mean([p for p, _ in inside]))
        judged = "" if len(inside) < FEWEST_IN_A_BIN else ", inside" if a <= stated <= b else ", outside"
        rows[label] = f"{hits}/{len(inside)} [{a:.2f}, {b:.2f}], stated {stated:.2f}{judged}"
    return rows


def table(columns: Mapping[str, Mapping[str, str]]) -> str:
    """The columns as a Markdown table."""
    lines = ["| | " + " | ".join(columns) + " |", "|---" * (1 + len(columns)) + "|"]
    for row in next(iter(columns.values())):
        entries = [one[row] for one in columns.values()]
        if set(entries) != {"-"}:
            lines.append(f"| {row} | " + " | ".join(entries) + " |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("set", type=Path)
    parser.add_argument("answers", type=Path, nargs="+")
    parser.add_argument("--all", action="store_true", help="count also what is not identifiable")
    parser.add_argument("--answered", action="store_true", help="count only the cases that every file answers")
    options = parser.parse_args()
    truth: dict[str, Truth] = json.loads((options.set / "truth.json").read_text(encoding="utf-8"))
    if options.answered:
        for path in options.answers:
            truth = {name: t for name, t in truth.items() if name in json.loads(path.read_text(encoding="utf-8"))["cases"]}
    try:
        answers = {path.stem: read_answers(path, truth) for path in options.answers}
    except ValueError as error:
        raise SystemExit(str(error)) from None
    print(table({name: column(entry, truth, options.all) for name, entry in answers.items()}))


if __name__ == "__main__":
    main()
