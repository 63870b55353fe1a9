"""The simulator as the loop asks it: answers of many models to many tests, on all cores."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from zlib import crc32

import numpy as np

from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.inverse.close_loop.statistics.budget import Budget
from explicitfe.inverse.close_loop.workers import Workers
from explicitfe.inverse.measured.curve import Curve, programme_of
from explicitfe.inverse.predict.correction import Job, Run, kind_of
from explicitfe.inverse.predict.predict import kernels_of_test, predict_test
from explicitfe.inverse.predict.reduced import ReducedSpecimen, reduced_specimen
from explicitfe.inverse.predict.tissue import Numerics, parse_tissue
from explicitfe.platform.compiled.threads import cores
from explicitfe.platform.errors import InputError, RunError
from explicitfe.platform.host.compilation import announcing

Jobs = tuple[tuple[Curve, ...], tuple[str, ...]]  # a test, and the texts of a tissue and of others that differ from it by little


def _answer(job: Jobs) -> list[Run | None]:
    """What the curves of a test answer with each tissue; None for one that could not be computed beside the first."""
    test, (text, *others) = job
    try:
        tissue, variants = parse_tissue(text), [parse_tissue(other) for other in others]
        with announcing(kernels_of_test(test, tissue)):
            answers = predict_test(test, tissue, variants=variants)
    except (RunError, InputError, ValueError) as error:  # ValueError: values that a table of the scenario refuses
        return [str(error), *[None] * len(others)]
    runs: list[Run | None] = [[answer.values for answer in answers]]
    for number in range(len(others)):
        values = [answer.variants[number] for answer in answers] if answers[0].variants else [None]
        runs.append(None if any(v is None for v in values) else [v for v in values if v is not None])
    return runs


class Simulator:
    """Answers of many models to many tests, on all cores; what was computed once is kept.

    Parameters
    ----------
    processes : at most so many; one a core if left out.
    budget : counts the runs.
    """

    def __init__(self, processes: int | None = None, budget: Budget | None = None) -> None:
        self.workers = Workers(min(processes or cores(), cores()), budget)
        self._kept: dict[tuple[str, ...], Run] = {}
        self._asked: set[tuple[str, ...]] = set()  # test and text of each tissue that was computed or tried
        self._reduced: dict[str, ReducedSpecimen | None] = {}

    def run(self, jobs: Sequence[Job], beside: Sequence[Sequence[str]] = (), *, again: bool = False) -> list[Run]:
        """What the curves of each test answer in SI, or why they cannot.

        Parameters
        ----------
        beside : for each job texts of tissues that differ by little. They are computed with it where that is cheap, for later.
        again : repeat a run whose result is known if a text in ``beside`` has not been computed yet.
        """
        keys = [(*map(_identity, test), text) for test, text in jobs]
        wanted: dict[tuple[str, ...], Jobs] = {}
        for number, (key, (test, text)) in enumerate(zip(keys, jobs, strict=True)):
            others = [other for other in dict.fromkeys(beside[number] if beside else ()) if (*key[:-1], other) not in self._asked]
            if key not in wanted and (key not in self._kept or (again and others)):
                wanted[key] = test, (text, *(other for other in others if other != text))
            self._asked |= {(*key[:-1], other) for other in (text, *others)}
        todo = list(wanted.values())
        together = self.workers.processes > 1 and len(todo) > 1 and any(map(_on_a_mesh, todo))
        for job, runs in zip(todo, self.workers.each(_answer, todo, together=together), strict=True):
            self._keep(job, runs)
        return [self._kept[key] for key in keys]

    def known(self, jobs: Sequence[Job]) -> list[Run | None]:
        """As :meth:`run`, but None for what has not been computed."""
        return [self._kept.get((*map(_identity, test), text)) for test, text in jobs]

    def reduced(self, curve: Curve, curves: Sequence[Curve], law: Yeoh, numerics: Numerics) -> ReducedSpecimen | None:
        """The reduced specimen of a test and of those among others that differ from it in their course only, with the elastic
        states of the first law that asks for it."""
        kind = kind_of(curve)
        if kind not in self._reduced:
            self._reduced[kind] = reduced_specimen([one for one in curves if kind_of(one) == kind], law, numerics)
        return self._reduced[kind]

    def _keep(self, job: Jobs, runs: Sequence[Run | None]) -> None:
        test, texts = job
        for text, run in zip(texts, runs, strict=True):
            if run is not None:
                self._kept.setdefault((*map(_identity, test), text), run)
        self.workers.budget.spend()


def same_courses(test: Sequence[Curve], other: Sequence[Curve]) -> bool:
    """Whether a model answers alike to the curves of two tests."""
    return len(test) == len(other) and all(a is b or _identity(a) == _identity(b) for a, b in zip(test, other, strict=True))


def _on_a_mesh(job: Jobs) -> bool:
    """Whether a run is that of a mesh, and not of one homogeneous state."""
    (first, *_), (text, *_) = job
    return first.tool is not None and (first.tool.shape != "platen" or not _is_pointwise(text))


@lru_cache(maxsize=10_000)
def _is_pointwise(text: str) -> bool:
    """Whether a homogeneous state stays so with all effects of a tissue's text."""
    return all(effect.pointwise for effect in parse_tissue(text).effects.chosen)


@lru_cache(maxsize=10_000)
def _identity(curve: Curve) -> str:
    """A text that is equal for curves that a model answers alike, whatever was measured in them."""
    course = crc32(np.concatenate([curve.time_s, programme_of(curve)]).tobytes())
    return f"{curve.specimen!r}|{curve.tool!r}|{curve.constants}|{curve.conditions!r}|{len(curve.time_s)}|{course}"
