"""Spoilt input of every kind, a short and fixed choice; the long run is studies/benchmarks/fuzz.py."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import pytest
from fuzz_inputs import KINDS, FuzzInput
from fuzz_verdict import judged
from hypothesis import HealthCheck, given, settings

pytestmark = pytest.mark.slow

# So many inputs take about a second of each kind. Damaged result files could end the process; they have a study of their own.
EXAMPLES = 25
IN_PROCESS = [kind for kind in KINDS if kind != "result files"]


@pytest.mark.parametrize("kind", IN_PROCESS)
def test_spoilt_input_ends_with_a_sentence(kind: str) -> None:
    @settings(max_examples=EXAMPLES, derandomize=True, database=None, deadline=None, suppress_health_check=list(HealthCheck))
    @given(KINDS[kind])
    def hold(one: FuzzInput) -> None:
        folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
        try:
            assert not judged(one, folder).faults, one.arguments
        finally:
            shutil.rmtree(folder)

    hold()
