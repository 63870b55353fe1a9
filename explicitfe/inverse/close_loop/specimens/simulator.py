"""The simulator as the loop asks it: answers of many models to many tests, on all cores."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from functools import lru_cache
from itertools import groupby
from zlib import crc32

import numpy as np

from explicitfe.fem.inputs.bounds import check_fields
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.inverse.close_loop.statistics.budget import Budget
from explicitfe.inverse.close_loop.workers import Workers
from explicitfe.inverse.measured.curve import Curve, programme_of
from explicitfe.inverse.predict.correction import Job, Run, kind_of
from explicitfe.inverse.predict.predict import kernels_of_test, predict_tests
from explicitfe.inverse.predict.reduced import ReducedSpecimen, reduced_specimen
from explicitfe.inverse.predict.tissue import Numerics, Tissue
from explicitfe.platform.compiled.threads import cores
from explicitfe.platform.errors import InputError, RunError
from explicitfe.platform.host.compilation import announcing

Jobs = tuple[tuple[Curve, ...], tuple[Tissue, ...]]  # a test, and a tissue with others that differ from it by little
Key = tuple[Hashable, ...]


def _answers(jobs: Sequence[Jobs]) -> list[list[Run | None]]:
    """What the curves of each test answer with each tissue; None for one that could not be computed beside the first.

    Parameters
    ----------
    jobs : one, or several tests without a tool with one tissue, which are computed together.
    """
    test, (tissue, *variants) = jobs[0]
    try:
        for effect in tissue.effects.chosen:
            check_fields(effect)
        with announcing(kernels_of_test(test, tissue)):
            together = predict_tests([test for test, _ in jobs], tissue, variants=variants)
    except (RunError, InputError, ValueError) as error:  # ValueError: values that a table of the scenario refuses
        return [[str(error), *[None] * len(variants)] for _ in jobs]
    runs: list[list[Run | None]] = []
    for answers in together:
        if isinstance(answers, RunError):
            runs.append([str(answers)])
            continue
        runs.append([[answer.values for answer in answers]])
        for number in range(len(variants)):
            values = [answer.variants[number] for answer in answers] if answers[0].variants else [None]
            runs[-1].append(None if any(v is None for v in values) else [v for v in values if v is not None])
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
        self._kept: dict[Key, Run] = {}
        self._asked: set[Key] = set()  # test and tissue that were computed or tried
        self._reduced: dict[str, ReducedSpecimen | None] = {}

    def run(self, jobs: Sequence[Job], beside: Sequence[Sequence[Tissue]] = (), *, again: bool = False) -> list[Run]:
        """What the curves of each test answer in SI, or why they cannot.

        Parameters
        ----------
        beside : for each job tissues that differ by little. They are computed with it where that is cheap, for later.
        again : repeat a run whose result is known if a tissue in ``beside`` has not been computed yet.
        """
        keys = [_key(*job) for job in jobs]
        wanted: dict[Key, Jobs] = {}
        for number, (key, (test, tissue)) in enumerate(zip(keys, jobs, strict=True)):
            given = {_key(test, other): other for other in (beside[number] if beside else ())}
            others = {own: other for own, other in given.items() if own not in self._asked}
            if key not in wanted and (key not in self._kept or (again and others)):
                wanted[key] = test, (tissue, *(other for own, other in others.items() if own != key))
            self._asked |= {key, *others}
        # Tests of one tissue without a tool are computed in one call, each other one by itself.
        alike = groupby(wanted.values(), lambda job: id(job[1][0] if job[0][0].tool is None else job))
        todo = [list(jobs) for _, jobs in alike]
        together = self.workers.processes > 1 and len(todo) > 1 and any(_on_a_mesh(job) for job, *_ in todo)
        for computed, runs in zip(todo, self.workers.each(_answers, todo, together=together), strict=True):
            self._keep(computed, runs)
        return [self._kept[key] for key in keys]

    def known(self, jobs: Sequence[Job]) -> list[Run | None]:
        """As :meth:`run`, but None for what has not been computed."""
        return [self._kept.get(_key(*job)) for job in jobs]

    def reduced(self, curve: Curve, curves: Sequence[Curve], law: Yeoh, numerics: Numerics) -> ReducedSpecimen | None:
        """The reduced specimen of a test and of those among others that differ from it in their course only, with the elastic
        states of the first law that asks for it."""
        kind = kind_of(curve)
        if kind not in self._reduced:
            self._reduced[kind] = reduced_specimen([one for one in curves if kind_of(one) == kind], law, numerics)
        return self._reduced[kind]

    def _keep(self, jobs: Sequence[Jobs], computed: Sequence[Sequence[Run | None]]) -> None:
        for (test, tissues), runs in zip(jobs, computed, strict=True):
            for tissue, run in zip(tissues, runs, strict=True):
                if run is not None:
                    self._kept.setdefault(_key(test, tissue), run)
            self.workers.budget.spend()


def same_courses(test: Sequence[Curve], other: Sequence[Curve]) -> bool:
    """Whether a model answers alike to the curves of two tests."""
    return len(test) == len(other) and all(a is b or _identity(a) == _identity(b) for a, b in zip(test, other, strict=True))


def _on_a_mesh(job: Jobs) -> bool:
    """Whether a run is that of a mesh, and not of one homogeneous state."""
    (first, *_), (tissue, *_) = job
    return first.tool is not None and (first.tool.shape != "platen" or not all(e.pointwise for e in tissue.effects.chosen))


def _key(test: Sequence[Curve], tissue: Tissue) -> Key:
    """Equal for a test and a tissue with the same answer."""
    return (*map(_identity, test), *tissue.key)


@lru_cache(maxsize=10_000)
def _identity(curve: Curve) -> str:
    """A text that is equal for curves that a model answers alike, whatever was measured in them."""
    course = crc32(np.concatenate([curve.time_s, programme_of(curve)]).tobytes())
    return f"{curve.specimen!r}|{curve.tool!r}|{curve.constants}|{curve.conditions!r}|{len(curve.time_s)}|{course}"
