"""Hooks of mkdocs (see mkdocs.yml) that add generated pages and links to the site.

- Pages generated from the program: the command line, all keys, the Python API.
- ``models/*/SOURCES.md`` and ``CHANGELOG.md``, which are outside docs/.
- Links to the glossary at the first use of a term.
- Formulas as MathML.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path

from command_page import command_page
from glossary import Glossary
from key_pages import dataset_page, other_files_page, result_page, scenario_page
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from python_page import python_page

ROOT = Path(__file__).resolve().parents[2]
GENERATED = {
    "reference/cli.md": command_page,
    "reference/scenario-keys.md": scenario_page,
    "reference/dataset-keys.md": dataset_page,
    "reference/file-keys.md": other_files_page,
    "reference/result-keys.md": result_page,
    "reference/python.md": python_page,
}
FROM_THE_TOP = (
    *(f"models/{name}/SOURCES.md" for name in ("tongue", "velum", "pharynx-walls", "specimen")),
    "CHANGELOG.md",
)
GLOSSARY = "explanation/glossary.md"
_CODE = re.compile(r"(^```.*?^```$|`[^`\n]+`)", re.M | re.S)
_FORMULA = re.compile(r"^\$\$(.+?)\$\$$", re.M | re.S)
_INLINE_FORMULA = re.compile(r"(?<![\\$\w])\$(?=\S)([^$\n]+?)(?<=\S)\$(?![\w$])")
_LINK_TO_THE_TOP = re.compile(rf"\]\((?:\.\./)+({'|'.join(map(re.escape, FROM_THE_TOP))})\)")
_LINK_TO_DOCS = re.compile(r"\]\((?:\.\./)*docs/")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    for name, make in GENERATED.items():
        files.append(File.generated(config, name, content=make()))
    for name in FROM_THE_TOP:
        text = (ROOT / name).read_text(encoding="utf-8")
        files.append(File.generated(config, name, content=_LINK_TO_DOCS.sub(f"]({'../' * name.count('/')}", text)))
    return files


def typeset(markdown: str) -> str:
    """Formulas between dollar signs as MathML, which browsers draw without a script; code stays as it is."""
    parts = _CODE.split(markdown)
    for k in range(0, len(parts), 2):
        parts[k] = _FORMULA.sub(lambda match: convert(match[1], display="block"), parts[k])
        parts[k] = _INLINE_FORMULA.sub(lambda match: convert(match[1]), parts[k])
    return "".join(parts)


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Typeset formulas; redirect links to files outside docs/ to their copies in the site."""
    if page.file.src_uri not in GENERATED:
        markdown = typeset(markdown)
    up = posixpath.relpath(".", posixpath.dirname(page.file.src_uri) or ".")
    return _LINK_TO_THE_TOP.sub(lambda match: f"]({posixpath.join(up, match[1])})", markdown)


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Link the first use of each term to the glossary."""
    if page.file.src_uri in {GLOSSARY, *GENERATED, *FROM_THE_TOP}:
        return html
    target = files.get_file_from_path(GLOSSARY)
    assert target is not None
    return Glossary(ROOT / "docs" / GLOSSARY).linked(html, target.url_relative_to(page.file))
