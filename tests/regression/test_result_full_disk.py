"""A disk that fills while a result is written."""

from __future__ import annotations

import os

import numpy as np
import pytest
from support import ROOT
from tiny_result import displacement, python

from explicitfe.results import open_result


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="this system cannot reserve room on the disk")
def test_a_full_disk_costs_no_sample(tmp_path):
    """A limit on the size of files stands for the full disk: the same calls fail at the same places."""
    code = f"""
import resource, sys
sys.path.insert(0, {str(ROOT / "tests")!r})
from pathlib import Path
from tiny_result import add, start
from explicitfe.errors import InputError, RunError
from explicitfe.results import FAILED
resource.setrlimit(resource.RLIMIT_FSIZE, (600_000, 600_000))
folder = Path({str(tmp_path)!r})
try:
    start(folder / "large.vtkhdf", expected_samples=10_000)
except InputError as error:
    print(error)
run = start(folder / "a.vtkhdf")
step = 0
try:
    while True:
        add(run, step)
        step += 1
except RunError as error:
    print(error)
run.finish(FAILED, "disk full", {{}})
print(step)
"""
    at_start, later, samples = python(code).stdout.splitlines()
    assert at_start.startswith(f"cannot write results in {tmp_path} (File too large)")
    assert f"its {samples} samples so far stay readable" in later
    assert [*tmp_path.iterdir()] == [tmp_path / "a.vtkhdf"]
    with open_result(tmp_path / "a.vtkhdf") as result:
        assert result.status == "failed"
        np.testing.assert_array_equal(result.times, 1e-3 * np.arange(int(samples)))
        np.testing.assert_array_equal(result.displacement(), displacement(int(samples) - 1))
