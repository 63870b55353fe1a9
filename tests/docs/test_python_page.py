"""docs/tutorials/python.md: every example runs in a separate process, is short, and prints what the page says."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from docs_blocks import OFF_SCREEN, Block, blocks_of
from support import ROOT

import explicitfe

pytestmark = pytest.mark.slow

EXAMPLES = [(code, printed) for code, printed in pairwise(blocks_of("tutorials/python.md")) if code.language == "python"]
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """The folder of a reader, who follows the page from its beginning."""
    return tmp_path_factory.mktemp("reader")


def run(code: Block, folder: Path) -> str:
    """Run an example; give what it printed."""
    given = {"capture_output": True, "text": True, "cwd": folder, "env": os.environ | OFF_SCREEN}
    done = subprocess.run([sys.executable, "-c", code.text], check=False, **given)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(("code", "printed"), EXAMPLES, ids=[code.heading for code, _ in EXAMPLES])
def test_an_example_prints_what_the_page_says(code: Block, printed: Block, folder: Path):
    """Words are the same; numbers agree to two units of their last digit, as machines with other lanes sum in another order."""
    assert len(code.text.strip().splitlines()) <= 25
    if 'open_result("vowel-i")' in code.text and not (folder / "outputs" / "vowel-i.vtkhdf").exists():
        run(EXAMPLES[0][0], folder)  # where this test runs alone
    text = run(code, folder)
    assert NUMBER.sub("#", text) == NUMBER.sub("#", printed.text)
    for seen, said in zip(NUMBER.findall(text), NUMBER.findall(printed.text), strict=True):
        decimals = len(said.partition(".")[2])
        allowed = 2.0 * 10.0**-decimals if decimals else 0.0
        assert abs(float(seen) - float(said)) <= allowed * (1.0 + 1e-9), (seen, said)


def test_all_names_of_the_facade_exist():
    for name in explicitfe.__all__:
        assert getattr(explicitfe, name) is not None
        assert name in dir(explicitfe)


def test_a_command_stays_a_function_when_its_folder_is_imported():
    code = "import explicitfe as fe, explicitfe.simulate.sweep.rows; print(callable(fe.run), callable(fe.sweep))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.split() == ["True", "True"]
