"""docs/tutorials/python.md: every example runs in a process of its own, is short, and prints what the page says."""

from __future__ import annotations

import re
import subprocess
import sys
from itertools import pairwise

import pytest
from docs_blocks import Block, blocks_of
from support import ROOT

import explicitfe

EXAMPLES = [(code, printed) for code, printed in pairwise(blocks_of("tutorials/python.md")) if code.language == "python"]
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


@pytest.mark.parametrize(("code", "printed"), EXAMPLES, ids=[code.heading for code, _ in EXAMPLES])
def test_an_example_prints_what_the_page_says(code: Block, printed: Block):
    """Words are the same; numbers agree to two units of their last digit, as machines with other lanes sum in another order."""
    assert len(code.text.strip().splitlines()) <= 25
    done = subprocess.run([sys.executable, "-c", code.text], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    assert NUMBER.sub("#", done.stdout) == NUMBER.sub("#", printed.text)
    for seen, said in zip(NUMBER.findall(done.stdout), NUMBER.findall(printed.text), strict=True):
        decimals = len(said.partition(".")[2])
        allowed = 2.0 * 10.0**-decimals if decimals else 0.0
        assert abs(float(seen) - float(said)) <= allowed * (1.0 + 1e-9), (seen, said)


def test_all_names_of_the_facade_exist():
    for name in explicitfe.__all__:
        assert getattr(explicitfe, name) is not None
        assert name in dir(explicitfe)


def test_type_checkers_see_the_same_names():
    """The lazy table and the block for type checkers list the same names from the same modules."""
    text = (ROOT / "explicitfe" / "__init__.py").read_text(encoding="utf-8")
    pairs = {(name, module) for module, name in re.findall(r"^    from (explicitfe\.\S+) import (\w+) as \2$", text, re.M)}
    assert pairs
    assert pairs == set(explicitfe._PLACES.items())


def test_a_command_stays_a_function_when_its_folder_is_imported():
    code = "import explicitfe as fe, explicitfe.run.run, explicitfe.identify.fit; print(callable(fe.run), callable(fe.identify))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.split() == ["True", "True"]
