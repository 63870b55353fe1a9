"""The samples of a run, in a result file or in memory: how a run hands them over, and how measures and pictures read them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from explicitfe.fem.mesh.hexmesh import HexMesh, shape_functions
from explicitfe.platform.errors import InputError, nearest
from explicitfe.results.files.contents import FieldInfo, StoredBone
from explicitfe.results.files.layout import Quantity


class Recorder(ABC):
    """What a run hands its samples to."""

    @abstractmethod
    def samples(
        self,
        times_s: np.ndarray,
        rows: Mapping[str, np.ndarray],
        point_data: Mapping[str, np.ndarray],
        cell_data: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        """Take fields and history at some times; each array has the samples along its first axis."""

    def sample(
        self,
        time_s: float,
        row: Mapping[str, float | np.ndarray],
        point_data: Mapping[str, np.ndarray],
        cell_data: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        """Take one sample; see :meth:`samples`."""
        one_row, one_point, one_cell = (
            {name: np.asarray(value)[None] for name, value in (some or {}).items()} for some in (row, point_data, cell_data)
        )
        self.samples(np.array([time_s], dtype=float), one_row, one_point, one_cell)


class Recorded(ABC):
    """The samples of a run: fields at steps, a history, the mesh and the bones around it.

    Attributes
    ----------
    path : where it is, or what messages call it.
    """

    path: Path

    @property
    @abstractmethod
    def status(self) -> str:
        """How the run ended: "finished", or another word."""

    @property
    @abstractmethod
    def model(self) -> Mapping[str, Any]:
        """The model that was run, as its analysis describes it."""

    @property
    @abstractmethod
    def mesh(self) -> HexMesh:
        """The reference mesh with its node sets and named points."""

    @property
    @abstractmethod
    def times(self) -> np.ndarray:
        """Times of the steps, (T,), s."""

    @property
    @abstractmethod
    def fields(self) -> dict[str, FieldInfo]:
        """The fields by name."""

    @property
    @abstractmethod
    def history_names(self) -> dict[str, Quantity]:
        """The history by name, ``time`` among it."""

    @property
    @abstractmethod
    def bones(self) -> dict[str, StoredBone]:
        """The bones that the body may touch, by name, at rest; empty where the run had none."""

    @abstractmethod
    def history(self, name: str) -> np.ndarray:
        """One history, (rows,) or (rows, components), in its unit; ``history("time")`` has the times of the rows."""

    def field(self, name: str, step: int = -1, *, time_s: float | None = None) -> np.ndarray:
        """Read one field at one stored step.

        Parameters
        ----------
        name : one of ``fields``, such as "displacement" or "J".
        step : 0 to T - 1, or negative from the end; -1 is the last.
        time_s : if given, the stored step nearest to this time is used instead of ``step``, s.

        Returns
        -------
        (N,) or (N, components) for point fields, (E,) or (E, components) for cell fields, in the field's unit.

        Raises
        ------
        InputError : no such field or step, or a time outside the stored ones.
        """
        if name not in self.fields:
            raise InputError(f'{self.path} has no field "{name}"; {nearest(name, self.fields)}')
        return self._of_step(name, self._step(step, time_s))

    def displacement(self, step: int = -1, *, time_s: float | None = None) -> np.ndarray:
        """Read the displacement of the nodes from their reference positions at one step; parameters as of :meth:`field`.

        Returns
        -------
        (N, 3), m.
        """
        return self.field("displacement", step, time_s=time_s)

    def probe(self, name: str) -> np.ndarray:
        """Displacement of a named point at all stored steps.

        Parameters
        ----------
        name : of the point, such as "tip".

        Returns
        -------
        (T, 3), m, at ``times``.

        Raises
        ------
        InputError : no such point.
        """
        points = self.mesh.named_points
        if name not in points:
            raise InputError(f'{self.path} has no named point "{name}"; {nearest(name, points)}')
        shares = shape_functions(points[name].natural[0])
        corners = np.flatnonzero(shares)  # mostly fewer than eight: a point lies on the surface, or in a plane of symmetry
        nodes = self.mesh.hexes[points[name].element[0], corners]
        moved = [self._of_step("displacement", step)[nodes] for step in range(len(self.times))]
        return np.einsum("a,tai->ti", shares[corners], np.array(moved).reshape(-1, len(corners), 3))

    @property
    def reaction_names(self) -> list[str]:
        """What exerts a reaction force on the body: fixed and prescribed node sets, supports and bones."""
        columns = [(column, front) for front in ("reaction_", "contact_") for column in self.history_names]
        names = [c[len(f) : -len("_force")] for c, f in columns if c.startswith(f) and c.endswith("_force")]
        return list(dict.fromkeys(names))

    def reaction(self, name: str) -> np.ndarray:
        """Force of a support, a fixed or prescribed node set or a bone on the body, at the times of the history.

        Parameters
        ----------
        name : one of ``reaction_names``. A bone that holds the body and touches it has the sum of both forces.

        Returns
        -------
        (rows, 3), N.

        Raises
        ------
        InputError : no such name, or the result was written by a version that did not store these forces.
        """
        if name not in self.reaction_names:
            raise InputError(f'{self.path} has no reaction force "{name}"; {nearest(name, self.reaction_names)}')
        columns = [f"{kind}_{name}_force" for kind in ("reaction", "contact")]
        return np.sum([self.history(column) for column in columns if column in self.history_names], axis=0)

    def placement(self, bone: str, step: int = -1, *, time_s: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Position of a bone at one step (see :meth:`field`): R (3, 3) and s (3,) m move its point X at rest to R X + s."""
        if f"bone_{bone}_placement" not in self.history_names:
            return np.eye(3), np.zeros(3)
        row = int(np.argmin(np.abs(self.history("time") - self.times[self._step(step, time_s)])))
        entries = self.history(f"bone_{bone}_placement")[row]
        return entries[:9].reshape(3, 3), entries[9:]

    def placed_bones(self, step: int = -1, *, time_s: float | None = None) -> dict[str, StoredBone]:
        """Surfaces of the bones at one step, given as in :meth:`field`."""
        placed = {}
        for name, bone in self.bones.items():
            if f"bone_{name}_placement" not in self.history_names:
                placed[name] = bone
                continue
            rotation, shift = self.placement(name, step, time_s=time_s)
            placed[name] = bone._replace(points=bone.points @ rotation.T + shift)
        return placed

    # ---- inside ----

    def _step(self, step: int, time_s: float | None) -> int:
        """Number of a stored step, 0 to T - 1."""
        count = len(self.times)
        if not count:
            raise InputError(f"{self.path} contains no stored step; run the scenario again.")
        if time_s is None:
            if not -count <= step < count:
                raise InputError(f"{self.path} has no step {step}; its steps are 0 to {count - 1}.")
            return step % count
        first, last = self.times[0], self.times[-1]
        rounding = 1e-9 * max(abs(first), abs(last))
        if not first - rounding <= time_s <= last + rounding:
            raise InputError(f"{self.path} has no time {time_s} s; its times are {first:g} s to {last:g} s.")
        return int(np.argmin(np.abs(self.times - time_s)))

    @abstractmethod
    def _of_step(self, name: str, step: int) -> np.ndarray:
        """A field that there is, at a step, 0 to T - 1."""
