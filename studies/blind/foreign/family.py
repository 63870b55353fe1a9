"""The foreign family of blind cases: made by programs that share no code with the simulator.

Homogeneous tests come from closed forms that keep the volume exactly, tests under a tool from an implicit solver with quadratic
elements. What is asked for names the source: a subject "tool: ..." is a test under a tool.
"""

from __future__ import annotations

import numpy as np

from explicitfe.platform.errors import RunError
from studies.blind.case import Case, CaseRequest
from studies.blind.foreign import homogeneous_cases as homogeneous
from studies.blind.foreign import tool_cases as tool

TOOL_PREFIX = "tool: "
DRAWS_OF_A_TOOL_CASE = 6  # A case that the solver cannot follow is drawn again, so often at most.


def choices(kind: str) -> list[tuple[str, ...]]:
    """The subjects that a kind of case can have; the cases of a set take them in turn."""
    if kind == "double":
        return [*homogeneous.HOMOGENEOUS_DOUBLES, *(tuple(TOOL_PREFIX + name for name in pair) for pair in tool.TOOL_DOUBLES)]
    plain, under = {
        "control": (homogeneous.HOMOGENEOUS_CONTROLS, tool.TOOL_PROTOCOLS),
        "single": (homogeneous.HOMOGENEOUS_SINGLES, tuple(tool.TOOL_SINGLES)),
        "outside": (homogeneous.HOMOGENEOUS_OUTSIDE, tool.TOOL_OUTSIDE),
    }[kind]
    return [*((name,) for name in plain), *((TOOL_PREFIX + name,) for name in under)]


def draw(rng: np.random.Generator, request: CaseRequest) -> Case:
    """Draw a case; draw again where the solver does not reach a state."""
    if not request.subjects[0].startswith(TOOL_PREFIX):
        return homogeneous.draw_homogeneous(rng, request)
    subjects = tuple(name.removeprefix(TOOL_PREFIX) for name in request.subjects)
    protocol = subjects[0] if request.kind == "control" else None
    for _ in range(DRAWS_OF_A_TOOL_CASE - 1):
        try:
            return tool.draw_under_a_tool(rng, request, subjects, protocol)
        except RunError:
            continue
    return tool.draw_under_a_tool(rng, request, subjects, protocol)
