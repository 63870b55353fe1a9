"""A curve as effects of the reading see it: what the machine recorded, in words that hold with a tool and without one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

MaterialKind = Literal["force-displacement", "uniaxial", "shear"]


@dataclass(frozen=True, eq=False)
class Record:
    """One recorded curve.

    Its motion is the displacement of a tool [m], or a strain: the stretch less 1, or the amount of shear. Its load is the
    force on a tool [N], or a nominal stress [Pa].

    Attributes
    ----------
    kind : force-displacement, uniaxial or shear: what its columns are.
    time_s : (k,) s.
    motion : (k,) as it was measured.
    cycle : number of the repeat, from 1.
    side : 1 where the largest motion is positive, -1 where it is negative, as in compression of a homogeneous state.
    one_sided : all motion lies on that side, so that there is a state that bears nothing beyond the first touch.
    whole : times (m,) [s] of all cycles of the test, counted from the start of this one, and the true column (m,); None for a
        test of one curve.
    """

    kind: MaterialKind
    time_s: np.ndarray
    motion: np.ndarray
    cycle: float = 1.0
    side: float = 1.0
    one_sided: bool = True
    whole: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def with_tool(self) -> bool:
        """Whether it has displacements and forces, and not strains and stresses."""
        return self.kind == "force-displacement"
