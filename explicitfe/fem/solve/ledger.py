"""Balance of the energies of a run in time, and the errors that follow from it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from explicitfe.fem.solve.observe import Snapshot
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.platform.compiled.arrays import EXTERNAL, HOURGLASS, INTERNAL, KINETIC

ROUNDINGS_IN_ENERGY = 100.0
# Hourglass energy means something where the elastic energy is at least this share of its largest.
ELASTIC_FLOOR_SHARE = 0.01
# Elastic energy below this share of the largest external work and kinetic energy is rounding: a body in free fall has none.
ROUNDING_SHARE = 1e-12


def balance(energies: np.ndarray) -> float:
    """Stored energy plus losses minus external work [J]; constant in time without numerical error."""
    return float(energies[:EXTERNAL].sum() + energies[EXTERNAL + 1 :].sum() - energies[EXTERNAL])


def rounding_of(simulation: Simulation) -> float:
    """Energy [J] below which the energy of a body is rounding error: rounding of volume ratios times its bulk modulus."""
    stiffness = simulation.model.in_elements(lambda law: law.constants()[-1]).max()
    return float(ROUNDINGS_IN_ENERGY * np.finfo(float).eps * stiffness * simulation.volumes.sum())


def impact_energy(simulation: Simulation) -> float:
    """Kinetic energy of the body at the largest speed of a bone with a path [J], the scale of errors at first touch."""
    paths = [bone.motion for bone in simulation.model.bones if bone.motion is not None and bone.motion.shift_m.ndim == 2]
    speeds = [np.linalg.norm(np.diff(one.shift_m, axis=0), axis=1) / np.diff(one.time_s) for one in paths]
    return float(0.5 * simulation.nodal_mass.sum() * max((speed.max() for speed in speeds), default=0.0) ** 2)


@dataclass
class Ledger:
    """Energies at the samples of a run, and the errors that follow from them.

    Attributes
    ----------
    energies : of each sample, (ENERGIES,) J.
    balance_errors : at each sample, the largest error of the energy balance so far, relative to the largest of external work,
        internal and kinetic energy.
    rounding_J : energies below it are rounding, and no measure of an error.
    """

    energies: list[np.ndarray] = field(default_factory=list)
    balance_errors: list[float] = field(default_factory=list)
    rounding_J: float = 0.0
    _scale: float = 0.0

    @property
    def balance_error(self) -> float:
        """The largest so far."""
        return self.balance_errors[-1] if self.balance_errors else 0.0

    @property
    def balance_error_of_run(self) -> float:
        """The largest error relative to the energies of the whole run: where a load begins, those at that time are small."""
        balances = [balance(e) for e in self.energies]
        scale = max(self._scale, self.rounding_J)
        return float(np.abs(np.subtract(balances, balances[0])).max() / scale) if scale > 0.0 else 0.0

    def add(self, snapshot: Snapshot) -> float:
        """Note a sample; its balance error relative to the largest of external work, internal and kinetic energy so far."""
        return self.add_until(snapshot.energies[None], np.inf)[1]

    def add_until(self, energies: np.ndarray, limit: float) -> tuple[int, float]:
        """Note samples, (k, ENERGIES), to the first whose balance error is not below ``limit``; how many, and the last error."""
        error = 0.0
        for count, e in enumerate(np.array(energies), 1):
            self.energies.append(e)
            self._scale = max(self._scale, abs(e[EXTERNAL]), e[INTERNAL] + e[HOURGLASS], e[KINETIC])
            scale = max(self._scale, self.rounding_J)
            error = abs(balance(e) - balance(self.energies[0])) / scale if scale > 0.0 else 0.0
            self.balance_errors.append(max(self.balance_error, error) if np.isfinite(error) else np.inf)
            if not error < limit:
                return count, error
        return len(energies), error

    @property
    def hourglass_share(self) -> float:
        """Largest share of the hourglass energy in the elastic energy, at samples with enough elastic energy."""
        energies = np.array(self.energies)
        elastic = energies[:, INTERNAL] + energies[:, HOURGLASS]
        elastic_enough = elastic > max(ELASTIC_FLOOR_SHARE * elastic.max(initial=0.0), self._rounding_J)
        return float(np.max(energies[elastic_enough, HOURGLASS] / elastic[elastic_enough], initial=0.0))

    @property
    def hourglass_share_at_end(self) -> float:
        """Share of the hourglass energy in the elastic energy at the last sample."""
        e = self.energies[-1]
        elastic = e[INTERNAL] + e[HOURGLASS]
        return float(e[HOURGLASS] / elastic) if elastic > self._rounding_J else 0.0

    @property
    def _rounding_J(self) -> float:
        energies = np.array(self.energies)
        return ROUNDING_SHARE * np.abs(energies[:, [EXTERNAL, KINETIC]]).max(initial=0.0)
