"""Samples of a sweep: a grid, random samples, a design for a sensitivity analysis, or the rows of a table."""

from __future__ import annotations

import csv
import io
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from explicitfe.platform.errors import InputError, shortened
from explicitfe.platform.host.extras import require
from explicitfe.platform.host.text import text_of
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.simulate.sweep.factors import Factor, setting_of, value_in

Design = Literal["grid", "random", "sobol", "morris", "table"]
MOST_MEMBERS = 10_000_000
LARGEST_TABLE_OF_MEMBERS_BYTES = 4 * 2**30
MORRIS_LEVELS = 4  # as in Morris (1991)
LARGEST_SEED_OF_A_SWEEP = 2**32 - 1  # the limit of SALib
NUMBER_COLUMN = "member"


@dataclass(frozen=True)
class Members:
    """The samples of the runs of a sweep, numbered from 0.

    Attributes
    ----------
    keys : varied keys of the scenario.
    values : of each run, in the order of the keys.
    """

    keys: tuple[str, ...]
    values: Sequence[tuple[object, ...]]

    def __len__(self) -> int:
        return len(self.values)

    def settings(self, number: int) -> tuple[str, ...]:
        """The settings of a run in the syntax of ``--set``."""
        return tuple(setting_of(key, value) for key, value in zip(self.keys, self.values[number], strict=True))

    def table(self) -> str:
        """All runs as CSV: their numbers, and their values in TOML syntax."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([NUMBER_COLUMN, *self.keys])
        writer.writerows([number, *map(toml_value, values)] for number, values in enumerate(self.values))
        return text.getvalue()


def grid(factors: Sequence[Factor]) -> Members:
    """All combinations of the values of the factors; the last factor varies fastest.

    Raises
    ------
    InputError : a factor has a range, or there are too many combinations.
    """
    for factor in factors:
        if factor.is_range:
            raise InputError(
                f"`vary` {factor.key}={factor.low:g}:{factor.high:g}: a grid needs a number of values, such as "
                f"{factor.low:g}:{factor.high:g}:9. For a range, add `random` N, `sobol` N or `morris` N."
            )
    _check_count(math.prod(len(factor.levels) for factor in factors), "`vary`")
    return Members(_keys(factors), list(itertools.product(*(factor.levels for factor in factors))))


def random(factors: Sequence[Factor], count: int, seed: int) -> Members:
    """Independent samples, uniform over each range and each list of values.

    Sample k depends only on the seed and on k, so that a larger count keeps the first samples.
    """
    _check_count(count, "`random`")
    _check_seed(seed)

    def drawn(number: int) -> tuple[object, ...]:
        rng = np.random.default_rng([seed, number])
        return tuple(
            float(rng.uniform(factor.low, factor.high))
            if factor.is_range
            else factor.levels[int(rng.integers(len(factor.levels)))]
            for factor in factors
        )

    return Members(_keys(factors), [drawn(number) for number in range(count)])


def sobol(factors: Sequence[Factor], base: int, seed: int) -> Members:
    """The design of Saltelli (2010) for Sobol indices: base times (factors + 2) runs, from a scrambled Sobol sequence.

    Raises
    ------
    InputError : a factor has no range, or ``base`` is no power of 2; or SALib is not installed.
    """
    require("sensitivity", "a Sobol analysis")
    problem = problem_of(factors, "`sobol`")
    if base < 2 or base & (base - 1):
        raise InputError(f"`sobol` {base}: must be a power of 2, such as 256.")
    _check_count(base * (len(factors) + 2), "`sobol`")
    _check_seed(seed)
    from SALib.sample import sobol as sampler

    return _in_ranges(factors, sampler.sample(problem, base, calc_second_order=False, seed=seed))


def morris(factors: Sequence[Factor], trajectories: int, seed: int) -> Members:
    """The design of Morris (1991) for elementary effects: trajectories times (factors + 1) members.

    Raises
    ------
    InputError : a factor has no range, or there are too few trajectories; or SALib is not installed.
    """
    require("sensitivity", "a Morris analysis")
    problem = problem_of(factors, "`morris`")
    if trajectories < 2:
        raise InputError(f"`morris` {trajectories}: the smallest number of trajectories is 2; 20 is usual.")
    _check_count(trajectories * (len(factors) + 1), "`morris`")
    _check_seed(seed)
    from SALib.sample import morris as sampler

    return _in_ranges(factors, sampler.sample(problem, trajectories, num_levels=MORRIS_LEVELS, seed=seed))


def problem_of(factors: Sequence[Factor], option: str) -> dict[str, Any]:
    """The factors in the format of SALib.

    Raises
    ------
    InputError : a factor has no range.
    """
    for factor in factors:
        if not factor.is_range:
            raise InputError(f"{option}: the factor {factor.key} needs a range, such as `vary` {factor.key}=0:1.")
    return {
        "num_vars": len(factors),
        "names": [factor.key for factor in factors],
        "bounds": [[factor.low, factor.high] for factor in factors],
    }


def from_table(path: Path) -> Members:
    """Read samples from a CSV file with one column per varied key and one row per run.

    A column "member" is ignored, so that ``members.csv`` of a sweep can be used again.

    Raises
    ------
    InputError : the table cannot be read, has no rows, or a row has another number of values than the header.
    """
    text = text_of(path, "name a CSV file with one column per key", largest_bytes=LARGEST_TABLE_OF_MEMBERS_BYTES)
    return members_in(text, path)


def members_in(text: str, path: Path) -> Members:
    """Parse the text of a table; see :func:`from_table`."""
    try:
        return _members_of_lines(csv.reader(io.StringIO(text)), path)
    except csv.Error as error:
        raise InputError(f"{path}: invalid CSV ({error}).") from None


def _members_of_lines(lines: Any, path: Path) -> Members:
    head = [key.strip() for key in next(lines, [])]
    keys = tuple(key for key in head if key != NUMBER_COLUMN)
    for key in keys:
        if not all(key.split(".")) or head.count(key) > 1:
            raise InputError(
                f'{path}: the column "{shortened(key)}" is no key of a scenario, or occurs twice. The first line names each key '
                "once, such as muscle.GGp.force_N."
            )
    if not keys:
        raise InputError(f"{path}: the table has no columns. Its first line must name the varied keys.")
    values = []
    for line in lines:
        if not line:
            continue
        if len(line) != len(head) or not all(cell.strip() for cell in line):
            raise InputError(f"{path}: line {lines.line_num} must have one value for each of the {len(head)} columns.")
        try:
            values.append(tuple(value_in(cell) for key, cell in zip(head, line, strict=True) if key != NUMBER_COLUMN))
        except InputError as error:
            raise InputError(f"{path}: line {lines.line_num}: {error}") from None
    if not values:
        raise InputError(f"{path}: the table has no rows. Add one row per run.")
    _check_count(len(values), f"`table` {path}")
    return Members(keys, values)


def share_of(members: Members, share: str) -> list[int]:
    """The numbers of the runs of share ``K/N``: every N-th run, from the K-th one.

    Raises
    ------
    InputError : the share is invalid.
    """
    part, slash, whole = share.partition("/")
    if not slash or not (part.isdecimal() and whole.isdecimal()) or not 1 <= int(part) <= int(whole) <= MOST_MEMBERS:
        raise InputError(f"`only` {shortened(share)}: invalid share. Write K/N with K from 1 to N, such as 1/4.")
    return list(range(int(part) - 1, len(members), int(whole)))


def _in_ranges(factors: Sequence[Factor], sample: np.ndarray) -> Members:
    return Members(_keys(factors), [tuple(map(float, line)) for line in sample])


def _keys(factors: Sequence[Factor]) -> tuple[str, ...]:
    return tuple(factor.key for factor in factors)


def _check_count(count: int, option: str) -> None:
    if not 1 <= count <= MOST_MEMBERS:
        raise InputError(f"{option}: a sweep of {count} runs is not possible. Allowed range: 1 to {MOST_MEMBERS}.")


def _check_seed(seed: int) -> None:
    if not 0 <= seed <= LARGEST_SEED_OF_A_SWEEP:
        raise InputError(f"`seed` {seed}: allowed range: 0 to {LARGEST_SEED_OF_A_SWEEP}.")
