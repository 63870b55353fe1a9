"""Number of lanes of a vector."""

from __future__ import annotations

import os

from llvmlite.binding import get_host_cpu_features

from explicitfe.platform.errors import InputError

POSSIBLE_LANES = (2, 4, 8)


def _lanes() -> int:
    """Return the number of float64 lanes of a vector: the width of a register of this processor, or EXPLICITFE_LANES.

    More lanes than a register holds are slower (measured with AVX2: 4 lanes 45 ns, 8 lanes 64 ns per element and step), and fewer
    too; results are equal to rounding. The environment variable is for tests: one machine then tries them all.
    """
    asked = os.environ.get("EXPLICITFE_LANES", "")
    if asked == "":
        return 8 if get_host_cpu_features().get("avx512f", False) else 4
    if asked not in map(str, POSSIBLE_LANES):
        raise InputError(
            f'EXPLICITFE_LANES is "{asked}"; it can be {", ".join(map(str, POSSIBLE_LANES[:-1]))} or {POSSIBLE_LANES[-1]}.'
        )
    return int(asked)


WIDTH = _lanes()  # also the number of elements in a block of element data
