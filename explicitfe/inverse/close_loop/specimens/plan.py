"""How a test is computed: by its own course, or by one ramp off which all tests of its kind are read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from explicitfe.fem.effects import Effect, Measurement, physics_of, readings_of
from explicitfe.inverse.measured.curve import Curve, programme_of
from explicitfe.inverse.predict.correction import Correction, Job, for_ramps, kind_of, ramp_of, smoothed
from explicitfe.inverse.predict.reading import as_it_is, reading, true_programme, without_compliance
from explicitfe.inverse.predict.tissue import Tissue

# A pull of a tied disc up to this share of its largest push counts as the opposite of a push: the stiffness changes by about
# this share.
SMALL_PULL_SHARE = 0.02


@dataclass(frozen=True)
class Plan:
    """A run, and how the curves of a test are read off it: directly, or from a ramp by their own programme.

    Attributes
    ----------
    job : the run.
    test : curves as they were measured, which are read off it.
    readings : what the machine misreads.
    by_force : the force is imposed.
    by_ramp : the run is a ramp.
    compliance_m_N : of the rig, which the run leaves out.
    by_hexahedra : the run is one of hexahedra, whose answer ripples with the depth.
    """

    job: Job
    test: tuple[Curve, ...]
    readings: tuple[Measurement, ...] = ()
    by_force: bool = False
    by_ramp: bool = False
    compliance_m_N: float = 0.0
    by_hexahedra: bool = True

    def read(self, answer: Sequence[np.ndarray], corrections: Mapping[str, Correction]) -> dict[str, np.ndarray]:
        """Curve -> what it would measure, SI."""
        courses, _ = self.job
        true = []
        for number, curve in enumerate(self.test):
            if not self.by_ramp:
                programme, values = programme_of(courses[number]), answer[number]
            else:
                given = true_programme(programme_of(curve), curve, self.readings, self.by_force)
                ramp = programme_of(courses[0])
                rippled = corrections and self.by_hexahedra
                smooth = smoothed(answer[0], ramp) if rippled else answer[0]
                machine = ramp if self.by_force else ramp + self.compliance_m_N * smooth
                programme = np.interp(given, machine, ramp) if self.compliance_m_N > 0.0 and not self.by_force else given
                # A tool that is not tied keeps its first answer, such as a preload, where it is lifted; a small pull of a tied
                # one is the opposite of a push.
                least = -ramp[-1] if _is_tied(curve) else 0.0
                inside = np.clip(programme, least, ramp[-1])
                change = PchipInterpolator(ramp, smooth)(np.abs(inside)) - smooth[0]
                values = smooth[0] + np.sign(inside) * change
            if curve.id in corrections:
                values = corrections[curve.id].applied(values, programme, self.by_force)
            if self.by_force:
                values = values + self.compliance_m_N * programme
            true.append(values)
        read = reading(true, self.test, self.readings, self.by_force)
        return {curve.id: values for curve, values in zip(self.test, read, strict=True)}


def plan_of(tissue: Tissue, test: tuple[Curve, ...], curves: Sequence[Curve], homogeneous: bool, *, ramps: bool = True) -> Plan:
    """How a test is computed: by one ramp for all tests of its kind, where the answer does not depend on the past.

    Parameters
    ----------
    test : curves that are measured one after the other.
    curves : all that are asked for.
    homogeneous : the tests are homogeneous states where no effect speaks against it.
    ramps : whether a ramp may do; a prediction with a model file follows the course itself.
    """
    first = test[0]
    if first.tool is None:
        return Plan((test, tissue), test)
    effects = tissue.effects.chosen
    readings = readings_of(effects)
    by_force = first.tool.control == "force"
    by_point = homogeneous and all(effect.pointwise for effect in effects)
    # What a mesh changes in a state that is homogeneous without it is small, so a ramp does for friction too.
    by_ramp = _forgets_its_past(first, effects) or (homogeneous and not any(effect.remembers for effect in effects))
    follows = by_point or not by_ramp or not ramps
    compliance = 0.0
    if not by_point and (by_force or not follows):
        tissue, compliance = without_compliance(tissue)
    tissue = tissue.model_copy(update={"effects": tissue.effects.without(readings)})
    if follows:
        # The run is what really happens; tests whose readings leave the programme as it is share it.
        courses = tuple(as_it_is(curve, readings) for curve in test)
        return Plan((courses, tissue), test, readings, by_force, compliance_m_N=compliance)
    alike = [c for c in curves if kind_of(c) == kind_of(first)]
    return Plan(
        ((ramp_of(first, alike, readings),), for_ramps(tissue)),
        test,
        readings,
        by_force,
        by_ramp=True,
        compliance_m_N=compliance,
        by_hexahedra=not is_section(tissue),
    )


def is_section(tissue: Tissue) -> bool:
    """Whether tests under a tool are computed in a section of a body of revolution."""
    return tissue.numerics.section > 0.0 and all(effect.in_revolution for effect in physics_of(tissue.effects.chosen))


def _forgets_its_past(curve: Curve, effects: Sequence[Effect]) -> bool:
    """Whether neither time nor what came before changes the answer; a tied disc that pulls needs its whole course."""
    assert curve.tool is not None
    by_path = any(effect.depends_on_path for effect in effects)
    programme = programme_of(curve)
    pulls = _is_tied(curve) and programme.min() < -SMALL_PULL_SHARE * programme.max()
    return not by_path and not pulls and curve.tool.friction in (0.0, "unknown", "stick")


def _is_tied(curve: Curve) -> bool:
    return curve.tool is not None and curve.tool.shape == "bonded-disc"
