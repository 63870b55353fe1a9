"""``explicitfe.sweep``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from explicitfe.platform.errors import InputError

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from explicitfe.simulate.sweep.factors import Factor
    from explicitfe.simulate.sweep.members import Design, Members
    from explicitfe.simulate.sweep.own_measure import Measuring
    from explicitfe.simulate.sweep.sweep import Sweep


@dataclass(frozen=True, kw_only=True)
class SweepDesign:
    """How the runs of a sweep are chosen: a full grid of the values to vary, unless one of the other designs is given.

    Parameters
    ----------
    random : draw this number of random samples instead of a grid.
    sobol : N, a power of 2, of a design for Sobol indices with N x (factors + 2) runs.
    morris : N of a design for elementary effects (Morris) with N x (factors + 1) runs.
    table : read the samples from a CSV file with one column per key and one row per run.
    seed : random seed.
    """

    random: int | None = None
    sobol: int | None = None
    morris: int | None = None
    table: Path | str | None = None
    seed: int = 0

    @property
    def name(self) -> Design:
        """The one design that is given.

        Raises
        ------
        InputError : several are given.
        """
        designs: tuple[Design, ...] = ("random", "sobol", "morris", "table")
        given = [design for design in designs if getattr(self, design) is not None]
        if len(given) > 1:
            raise InputError(f"`{given[0]}` and `{given[1]}` are different designs; give one of them.")
        return given[0] if given else "grid"

    def members(self, factors: Sequence[Factor]) -> Members:
        """The runs.

        Raises
        ------
        InputError : a factor is missing, or cannot be used in this design.
        """
        from explicitfe.simulate.sweep import members as designs

        design = self.name
        if design == "table":
            if factors:
                raise InputError(
                    "`vary` cannot be combined with `table`: the columns of the table are the factors. Remove one of the options."
                )
            return designs.from_table(Path(self.table or ""))
        if not factors:
            raise InputError("no factor is given; add `vary`, such as `vary` muscle.GGp.force_N=0:4:9, or `table` FILE.")
        if design == "grid":
            return designs.grid(factors)
        return getattr(designs, design)(factors, getattr(self, design), self.seed)


@dataclass(frozen=True, kw_only=True)
class SweepExecution:
    """Where the runs of a sweep are computed.

    Parameters
    ----------
    processes : number of local worker processes; by default the number of cores. With an executor, the number of its workers, if
        it has no such attribute.
    executor : any ``concurrent.futures.Executor`` that computes the runs instead; it is not shut down.
    scheduler : address of a Dask scheduler that distributes the runs instead, such as tcp://HOST:8786.
    """

    processes: int | None = None
    executor: Executor | None = None
    scheduler: str | None = None


def sweep(
    scenario: Path | str,
    vary: Sequence[str] | Mapping[str, Iterable[object]] = (),
    *,
    out: Path | str | None = None,
    settings: Sequence[str] | Mapping[str, object] = (),
    measures: Sequence[str | Measuring] | None = None,
    keep: str = "none",
    retry: bool = False,
    only: str | None = None,
    design: SweepDesign = SweepDesign(),
    execution: SweepExecution = SweepExecution(),
    **options: Any,
) -> Sweep:
    """Run a parameter sweep: iteration yields the rows of all runs, those of new runs as they finish.

    >>> for row in explicitfe.sweep("vowel-i", ["muscle.GGp.force_N=0:4:9"], settings=["model.resolution=coarse"]):
    ...     print(row["member"], row["status"], row.get("points.tip.up_mm"))

    Rows are stored in ``out`` before they are yielded; the same call resumes an interrupted sweep.
    At the end the table is written to ``out``.

    Parameters
    ----------
    scenario : file, or the name of a built-in scenario.
    vary : ``KEY=LOW:HIGH:N``, ``KEY=LOW:HIGH`` or ``KEY=a,b,c`` for each factor, or a dictionary of keys and values, such as
        ``{"muscle.GGp.force_N": np.linspace(0, 4, 9)}``: a full grid, unless another design is given.
    out : folder of the sweep; by default outputs/sweep-NAME.
    settings : ``key=value`` texts or a dictionary, for all runs.
    measures : groups of measures, such as "points", and functions of a result and a step that return a dict of numbers. A
        function must be defined in a module, so that workers can import it.
    keep : result files to keep: none, all, failed or every:N.
    retry : recompute failed runs.
    only : compute only the K-th of N shares, K/N, for parallel jobs.
    design : how the runs are chosen.
    execution : where the runs are computed.
    options : fields of ``design`` and ``execution``, which can be given directly, such as ``random=100`` or ``processes=4``.

    Raises
    ------
    InputError : an argument is invalid; nothing was computed.
    """
    from explicitfe.platform.host.shipped import scenario_file
    from explicitfe.simulate.scenario.read import setting_texts
    from explicitfe.simulate.sweep.definition import define
    from explicitfe.simulate.sweep.factors import factors_of
    from explicitfe.simulate.sweep.rows import USUAL_PARTS
    from explicitfe.simulate.sweep.sweep import Sweep, engine_for

    path = scenario_file(scenario)
    of_design = {field.name for field in fields(SweepDesign)} & options.keys()
    design = replace(design, **{name: options.pop(name) for name in of_design})
    execution = replace(execution, **options)
    name, factors = design.name, factors_of(vary)
    definition = define(
        path,
        tuple(setting_texts(settings)),
        design.members(factors),
        design=name,
        factors=factors,
        seed=design.seed,
        measures=USUAL_PARTS if measures is None else measures,
        origin=str(design.table) if name == "table" else "`vary`",
    )
    folder = Path("outputs") / f"sweep-{path.stem}" if out is None else Path(out)
    engine = partial(engine_for, execution.processes, execution.executor, execution.scheduler)
    return Sweep(definition, folder, engine, keep=keep, retry=retry, only=only)
