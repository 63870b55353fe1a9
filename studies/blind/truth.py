"""The truth of a case, as its sealed file states it: what is hidden in the data, and whether that can be told at all."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NotRequired

from typing_extensions import TypedDict

from studies.blind.grid import Parameters
from studies.blind.identifiable import Separation


class NoiseTruth(TypedDict):
    """The noise that was added, and what the dataset states of it."""

    level: float
    sd: float
    rho: float
    scale_sd: float
    offset_sd: float
    stated: bool
    repeats_stated: bool


class SeparationTruth(TypedDict):
    """How far the true curves stay from what could stand for them (see ``identifiable.py``)."""

    baseline: float
    rivals: dict[str, float]
    nearest: str | None


class WrongLength(TypedDict):
    """A length that the dataset states wrongly by a factor; ``where``: in the table of the specimen or of the tool."""

    where: NotRequired[str]
    key: str
    factor: float


class CommonTruth(TypedDict):
    """What the truths of all families have in common.

    ``sub`` is the control or the outsider, ``effects`` are the hidden effects of the library, and ``outside`` is the hidden law
    that is not in it.
    """

    kind: str
    sub: str | None
    effects: dict[str, Parameters]
    outside: dict[str, Parameters]
    C10_Pa: float
    C20_Pa: float
    noise: NoiseTruth
    identifiable: bool | None
    separation: SeparationTruth | None


class Truth(CommonTruth):
    """The truth of a case; ``rows`` counts the rows of each curve."""

    protocol: str
    mode: str
    test: str
    holdout: bool
    rows: dict[str, int]
    wrong: WrongLength | None


def common_truth(
    kind: str,
    subject: str,
    effects: Mapping[str, Parameters],
    constants: tuple[float, float],
    noise: NoiseTruth,
    distances: Separation | None,
) -> CommonTruth:
    """The truth that cases of all families have in common; ``subject``: the control, the effect or the outsider."""
    outside = kind == "outside"
    return {
        "kind": kind,
        "sub": subject if kind in ("control", "outside") else None,
        "effects": {} if outside else dict(effects),
        "outside": dict(effects) if outside else {},
        "C10_Pa": constants[0],
        "C20_Pa": constants[1],
        "noise": noise,
        "identifiable": None if distances is None else distances.identifiable,
        "separation": None
        if distances is None
        else {"baseline": distances.baseline, "rivals": distances.rivals, "nearest": distances.nearest},
    }
