"""The claims of the page "Is it true?", in its order. ``explicitfe verify`` computes them; the table of the page is this list."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from explicitfe.app.verify import bodies, data, gerard, one_element, speech
from explicitfe.app.verify.claim import Claim

MODULES = {"bodies": bodies, "data": data, "gerard": gerard, "one_element": one_element, "speech": speech}
CLAIMS_FILE = Path(__file__).with_name("claims.toml")


def _claim(row: Any) -> Claim:
    module, _, function = row.pop("figure").partition(".")
    return Claim(**row, figure=getattr(MODULES[module], function))


CLAIMS = tuple(_claim(row) for row in tomllib.loads(CLAIMS_FILE.read_text(encoding="utf-8"))["claim"])
