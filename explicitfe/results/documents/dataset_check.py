"""Answer of ``explicitfe check`` for a dataset."""

from __future__ import annotations

from typing_extensions import TypedDict

MATERIAL_TESTS = ("indentation", "compression", "tension", "equibiaxial", "planar", "shear")  # the others are trajectories


class ColumnRange(TypedDict):
    """The least and the largest value of a column, in ``unit``."""

    column: str
    unit: str
    least: float
    largest: float


class CheckedCurve(TypedDict):
    """A curve of a dataset, and its use.

    ``side`` is "fit", "holdout" or "left out", with the reason in ``why``. ``noise_sd`` is the standard deviation of the
    predicted column in its unit, or of a coordinate in mm; None if the dataset does not state it.
    """

    id: str
    file: str
    side: str
    why: str
    constants: str
    rows: int
    duration_s: float
    columns: list[ColumnRange]
    imposed: str | None
    noise_sd: float | None


class HiddenEffect(TypedDict):
    """An effect that no curve of a dataset can show, and the data that it requires."""

    effect: str
    needs: str


class DatasetCheckReport(TypedDict):
    """A valid dataset: its curves, which of them are fitted by which rule, and which effects they can show.

    ``scenario`` and ``sensors`` (sensor -> point) belong to trajectories. ``warnings`` name missing information that weakens a
    verdict.
    """

    dataset: str
    title: str
    test: str
    file: str
    source: str
    license: str
    specimens: list[dict[str, object]]
    tools: list[dict[str, object]]
    scenario: str | None
    sensors: dict[str, str]
    rule: str
    curves: list[CheckedCurve]
    can_show: list[str]
    cannot_show: list[HiddenEffect]
    warnings: list[str]
