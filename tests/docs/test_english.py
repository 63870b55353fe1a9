"""Plain technical English: no banned word in help texts, messages, documentation pages and shipped scenarios.

The rules and the table of terms are in CONTRIBUTING.md; :data:`BANNED` is the part of them that a regular expression can check.
"""

from __future__ import annotations

import ast
import inspect
import re
import tomllib
from collections.abc import Iterator
from typing import NamedTuple

import pytest
from support import ROOT

BANNED = {
    r"fore(tell|tells|told|telling)": "predict",
    r"t(ell|ells|old|elling)( \w+)? apart|can(not)? be told": "distinguish, distinguishable, identifiable",
    r"(go|goes|going|gone|went) on\b(?! (forever|stage))": "continue, resume, follow",
    r"what is left|left over": "residual, remainder, remaining",
    r"(kept|held) back": "held out (of a fit), omitted",
    r"beside(?! each other)|besides": "next to, in addition to, outside",
    r"quotable|(can|may|be) quoted|(against|before) quoting": "all checks passed, reliable",
    r"machine code": "compiled kernels",
    r"folded|fold(s)? (over|anywhere)|(element|corner|hex)s? folds?": "inverted",
    r"hexes": "hexahedra",
    r"dear(er|est)?": "expensive",
    r"remembers?|remembered": "history-dependent, relaxation; stored, cached",
    r"whoever|nobody": "anyone who, no one; name the person or the object",
    r"as if nothing|all the same|believe nothing": "say what happens",
    r"(?<!half )of what": "name the object",
    r"anew": "again",
    r"mend(s|ed|ing)?": "fix, correct",
    r"fingerprints?": "signature",
    r"programmes?": "loading protocol",
    r"settles? (best|most|what|which|\d)": "information gain; decide, distinguish",
    r"looks? (in vain|whether)|gives? up its": "check, search",
    r"(program|data|model|fit|it) (does not |do not )?knows?": "state what is unknown to whom",
    r"(at|under|below|to) the floors?": "within the error bound",
    r"pace": "throughput, rate, speed",
    r"is asked for|are asked for|if asked for|asked of it": "requested",
    r"member(s)?(?= (of a|of the|in a|fails?|that|a minute|each|without)\b)": "run (of a sweep)",
}
PATTERNS = {re.compile(rf"(?<![\w-])(?:{words})(?![\w-])", re.I): advice for words, advice in BANNED.items()}
NOT_A_BEGINNING = re.compile(r"(Of|That|Where|What|Whose) ")
# Their reports are rewritten with the next version of the loop; only their errors are checked.
ERRORS_ONLY = ("inverse/close_loop",)
TOP = "modules of the top folder"
FOLDERS = [
    TOP,
    *sorted(str(path.parent.relative_to(ROOT / "explicitfe")) for path in (ROOT / "explicitfe").glob("*/*/__init__.py")),
]
# Only the first paragraph and the headings of tables of a study or a reference page are checked.
LONG_PAGES = re.compile(r"docs/(studies|reference)/")
PAGES = [
    "README.md",
    "CONTRIBUTING.md",
    "SUPPORT.md",
    "CHANGELOG.md",
    "mkdocs.yml",
    *sorted(str(path.relative_to(ROOT)) for path in (ROOT / "docs").rglob("*.md")),
]
_HIDDEN = re.compile(r"^```.*?^```$|``[^`]+``|`[^`\n]*`|<!--.*?-->|\]\([^)]*\)|https?://\S+", re.M | re.S)
_TABLE_HEADING = re.compile(r"^(\|.*\|)\n(?=\|[ :|-]+\|$)", re.M)


class Text(NamedTuple):
    """A text and where it is."""

    place: str
    words: str


def check(texts: Iterator[Text]) -> None:
    """Fail with one line per violation: place, words, what to write instead."""
    found = list(violations(texts))
    assert not found, "\n" + "\n".join(found)


def violations(texts: Iterator[Text]) -> Iterator[str]:
    for place, words in texts:
        plain = " ".join(_HIDDEN.sub(" ", words).split())
        for pattern, advice in PATTERNS.items():
            for match in pattern.finditer(plain):
                around = match.string[max(match.start() - 30, 0) : match.end() + 30]
                yield f"{place}: {around!r}: instead of {match[0]!r} write: {advice}"


def help_texts() -> Iterator[Text]:
    """Help of all commands, arguments and options."""
    import typer

    from explicitfe.app.cli.app import app

    def walk(command, name: str) -> Iterator[Text]:
        yield Text(f"{name} --help", command.help or "")
        for parameter in command.params:
            yield Text(f"{name} {(parameter.opts or [parameter.name])[0]}", getattr(parameter, "help", None) or "")
        for child, inner in getattr(command, "commands", {}).items():
            yield from walk(inner, f"{name} {child}")

    yield from walk(typer.main.get_command(app), "explicitfe")


def strings_of(folder: str) -> Iterator[Text]:
    """String literals of a folder of the package that hold several words: messages, labels, report texts; no docstrings."""
    paths = (ROOT / "explicitfe").glob("*.py") if folder == TOP else (ROOT / "explicitfe" / folder).rglob("*.py")
    for path in sorted(paths):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        roots = [node for node in ast.walk(tree) if _is_error(node)] if folder in ERRORS_ONLY else [tree]
        docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        parts = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
        for node in (node for root in roots for node in ast.walk(root)):
            if isinstance(node, ast.JoinedStr):
                words = "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings | parts:
                words = node.value
            else:
                continue
            if " " in words.strip():
                yield Text(f"{path.relative_to(ROOT)}:{node.lineno}", words)


def _is_error(node: ast.AST) -> bool:
    return isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("Error", "warn"))


def page_text(page: str) -> Iterator[Text]:
    """A page line by line, without code and addresses."""
    text = (ROOT / page).read_text(encoding="utf-8")
    text = _HIDDEN.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)
    if page == "CHANGELOG.md":
        text = text.partition("\n## 0.")[0]
    elif page == "CONTRIBUTING.md":
        text = text.partition("| avoid | write |")[0]
    if LONG_PAGES.match(page):
        abstract = "\n\n".join(text.split("\n\n")[:2])
        rows = [(0, abstract), *((match.start(), match[1]) for match in _TABLE_HEADING.finditer(text))]
    else:
        rows = [(match.start(), match[0]) for match in re.finditer(r"(?:^(?!\s*$).+\n?)+", text, re.M)]  # paragraphs
    for start, words in rows:
        yield Text(f"{page}:{text.count(chr(10), 0, start) + 1}", words)


def shipped_texts() -> Iterator[Text]:
    """Titles, questions and notes of the scenarios, datasets and models that come with the program."""
    for path in sorted(path for folder in ("scenarios", "models") for path in (ROOT / folder).rglob("*.toml")):
        yield from _strings(str(path.relative_to(ROOT)), tomllib.loads(path.read_text(encoding="utf-8")))


def _strings(place: str, value: object) -> Iterator[Text]:
    if isinstance(value, str) and " " in value:
        yield Text(place, value)
    elif isinstance(value, dict):
        for key, inner in value.items():
            yield from _strings(f"{place} {key}", inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _strings(place, inner)


def facade_texts() -> Iterator[Text]:
    """Docstrings of the public Python names."""
    import explicitfe

    for name in explicitfe.__all__:
        if name != "__version__":
            text = inspect.getdoc(getattr(explicitfe, name)) or ""
            yield Text(f"explicitfe.{name}", re.sub(r"^\w[\w, ]* : ", "", text, flags=re.M))  # without names of parameters


def test_help():
    texts = list(help_texts())
    check(iter(texts))
    assert [place for place, words in texts if NOT_A_BEGINNING.match(words)] == []
    assert [place for place, words in texts if "default:" in words] == [], "rich drops [default: ...]; use show_default"


@pytest.mark.parametrize("folder", FOLDERS)
def test_messages(folder):
    check(strings_of(folder))


@pytest.mark.parametrize("page", PAGES)
def test_pages(page):
    check(page_text(page))


def test_shipped_scenarios():
    check(shipped_texts())


def test_python_names():
    check(facade_texts())


def test_a_violation_is_found():
    """A banned word is reported with its place and what to write instead; a word that contains it is not."""
    (line,) = violations(iter([Text("here.md:3", "Constants of one\ncasting foretell another one.")]))
    assert line.startswith("here.md:3: ") and "'foretell'" in line and line.endswith("write: predict")
    assert not list(violations(iter([Text("here", "endearing folders, bones beside each other")])))
