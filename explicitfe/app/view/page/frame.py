"""The frame of a page: templates that escape all text, one style, and only scripts that the page lists by their digest.

A page is one file: no picture, style, letter or script comes from a network, and its content security policy lets none come.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from functools import cache
from hashlib import sha256
from importlib.resources import files
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

STYLE_FILE = "page/frame.css"


def page_text(template: str, *, styles: Sequence[str] = (), scripts: Sequence[str] = (), **values: object) -> str:
    """The text of a page.

    Parameters
    ----------
    template : its template, a file of ``explicitfe/app/view`` that extends ``page/frame.html.j2``.
    styles, scripts : files of ``explicitfe/app/view`` that the page carries: nothing else in it is ever run.
    values : what the template is filled with; every text of it is escaped.
    """
    programs = [_own_file(name) for name in scripts]
    digests = [f"'sha256-{b64encode(sha256(program.encode()).digest()).decode()}'" for program in programs]
    return (
        _environment()
        .get_template(template)
        .render(
            styles=[_own_file(name) for name in (STYLE_FILE, *styles)],
            scripts=programs,
            script_sources=" ".join(digests) or "'none'",
            **values,
        )
    )


@cache
def _own_file(name: str) -> Markup:
    """A style sheet or a script of this package, as it stands in a page."""
    from markupsafe import Markup

    return Markup(files("explicitfe.app.view").joinpath(name).read_text(encoding="utf-8"))


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader("explicitfe.app.view", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
