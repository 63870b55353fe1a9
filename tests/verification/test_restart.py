"""A state is all that the future depends on: a body that is given it goes on, bit for bit, as the one that it was taken from."""

from __future__ import annotations

import signal
import threading

import numpy as np
import pytest
from support import ROOT

from explicitfe.fem.model.profile import Profile
from explicitfe.fem.solve.course import AUTOMATIC_STEP, UNDAMPED_STEP
from explicitfe.fem.solve.load_outcome import Equilibrium
from explicitfe.fem.solve.transient import INTERRUPTED, Transient
from explicitfe.platform.host import stopping
from explicitfe.simulate.run.prepare import prepare

pytestmark = pytest.mark.slow

REAR = ROOT / "scenarios/indentation-rear.toml"
TONGUE = ROOT / "scenarios/vowel-i.toml"
COARSE = ("model.refinement=0.4", "analysis.threads=1")

INDENTATIONS = {
    "dead loads and forces": ("model.gravity_m_s2=[0, 0, -9.81]",),
    "friction": ("tool.friction=0.5", "model.symmetry=quarter"),
    "a tissue that relaxes": ("effects.viscoelastic={g=[0.3], tau_s=[1.0]}",),
    "a rig that gives way": ("effects.compliance={compliance_mm_N=0.5}",),
}


@pytest.mark.parametrize("settings", INDENTATIONS.values(), ids=INDENTATIONS)
@pytest.mark.parametrize("by_force", [True, False])
def test_an_indentation_goes_on_bit_by_bit(settings: tuple[str, ...], by_force: bool) -> None:
    """Also when the course turns back."""
    loads = (0.1, 0.2, 0.15, 0.3) if by_force else (0.5e-3, 1e-3, 0.8e-3, 1.5e-3)

    def load(body, number: int) -> Equilibrium:
        go = body.press if by_force else body.move
        answer = go(loads[number], at_s=float(number + 1))
        assert isinstance(answer, Equilibrium), answer
        return answer

    whole = prepare(REAR, [*COARSE, *settings]).body
    whole.settle()
    for number in range(2):
        load(whole, number)
    state = {name: array.copy() for name, array in whole.restart_state().items()}
    wanted = [load(whole, number) for number in (2, 3)]
    resumed = prepare(REAR, [*COARSE, *settings]).body
    resumed.restore(state)
    assert [load(resumed, number) for number in (2, 3)] == wanted
    assert np.array_equal(resumed.displacement, whole.displacement)
    for name, values in whole.restart_state().items():
        np.testing.assert_array_equal(resumed.restart_state()[name], values, err_msg=name)


def test_a_signal_gives_up_the_load_that_is_under_way() -> None:
    """The body is then back at the last equilibrium, and reaches the next load as if nothing had been."""
    body, untouched = (prepare(REAR, COARSE).body for _ in range(2))
    for one in (body, untouched):
        one.settle()
        one.press(0.1)
    before = body.restart_state()
    with stopping.watching():
        with pytest.raises(stopping.Stopped) as stopped:
            body.press(0.4, lambda share: signal.raise_signal(signal.SIGTERM))
        assert stopped.value.signal == signal.SIGTERM
        assert stopping.exit_code(stopped.value.signal) == 143
    for name, values in body.restart_state().items():
        if name != "counters" and name != "tool" and name != "monitor":  # iterations, a goal and a residual of no account
            np.testing.assert_array_equal(values, before[name], err_msg=name)
    assert body.press(0.3).displacement_m == untouched.press(0.3).displacement_m


@pytest.mark.parametrize("damping", [(), ("model.damping.alpha_per_s=0.0", "model.damping.beta_s=0.0")])
def test_a_signal_ends_a_run_in_time_between_two_steps(damping: tuple[str, ...]) -> None:
    """The state is then that of a whole step, from which the run goes on bit by bit."""
    settings = ("model.cells=[8, 4, 4]", "analysis.duration_ms=20", "analysis.threads=1", *damping)
    whole = Transient(prepare(TONGUE, settings).body, 0.020)
    for _ in whole.recordings(0.002):
        pass
    stopped = Transient(prepare(TONGUE, settings).body, 0.020)
    times: list[float] = []
    with stopping.watching():
        for recording in stopped.recordings(0.002, room=3):
            times += list(recording.time_s[: recording.count])
            if stopping.asked() is None:  # a second one would end it at once
                signal.raise_signal(signal.SIGINT)
    assert stopped.status is not None and stopped.status.state == INTERRUPTED
    assert 0.0 < stopped.simulation.time_s < 0.020
    resumed = Transient(prepare(TONGUE, settings).body, 0.020)
    resumed.restore(stopped.restart_state())
    for recording in resumed.recordings(0.002):
        times += list(recording.time_s[: recording.count])
    assert len(times) == 11 and np.all(np.diff(times) > 0.0)
    for name, values in whole.restart_state().items():
        np.testing.assert_array_equal(resumed.restart_state()[name], values, err_msg=name)


def test_signals_are_noted_once_and_handlers_put_back() -> None:
    """The first is noted, a second ends at once; what was ignored stays so; other threads change nothing."""
    before = signal.getsignal(signal.SIGTERM)
    heard: list[str] = []
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stopping.watching(lambda s: heard.append(f"first {s.name}"), lambda s: heard.append(f"second {s.name}")):
            signal.raise_signal(signal.SIGHUP)
            assert stopping.asked() is None
            signal.raise_signal(signal.SIGINT)
            with stopping.watching():  # changes nothing inside another one
                signal.raise_signal(signal.SIGTERM)
            with pytest.raises(stopping.Stopped, match="interrupted by Ctrl-C"):
                stopping.check()
        assert heard == ["first SIGINT", "second SIGTERM"]
        assert stopping.asked() is None
        stopping.check()
        with stopping.watching():
            handler = signal.getsignal(signal.SIGINT)
            assert callable(handler)
            handler(signal.SIGINT, None)
            with pytest.raises(KeyboardInterrupt):  # called, not sent: it must not come where nobody waits for it
                handler(signal.SIGINT, None)
    finally:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
    assert signal.getsignal(signal.SIGTERM) is before

    def elsewhere() -> None:
        with stopping.watching():
            heard.append("entered")

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert heard[-1] == "entered" and signal.getsignal(signal.SIGTERM) is before


UNDAMPED = ("model.damping.alpha_per_s=0.0", "model.damping.beta_s=0.0")


@pytest.mark.parametrize(("scenario", "damping"), [("vowel-i", ()), ("vowel-i", UNDAMPED), ("vowel-a", ()), ("sequence-iau", ())])
def test_a_run_does_not_depend_on_how_it_is_cut(scenario: str, damping: tuple[str, ...]) -> None:
    """How many steps are done at once follows the speed of the machine and what else it does; the numbers must not."""
    path = ROOT / f"scenarios/{scenario}.toml"
    looking = UNDAMPED_STEP if damping else AUTOMATIC_STEP
    ends = []
    for cuts in ([60], [16, 44], [1] * 60):
        transient = Transient(prepare(path, ["model.cells=[8, 4, 4]", "analysis.threads=1", *damping]).body, 0.2)
        simulation = transient.simulation
        for steps in cuts:
            assert simulation.go(steps, simulation.dt_s, looking=looking) == steps
        ends.append(simulation.restart_state())
    for end in ends[1:]:
        for name, values in ends[0].items():
            np.testing.assert_array_equal(end[name], values, err_msg=name)


def test_a_load_at_an_instant_does_not_depend_on_the_instants_asked_with_it() -> None:
    """To the last bit: near edges, between them, and with a lag."""
    times = np.linspace(0.0, 0.3, 997)
    for profile in (Profile.step(0.01, 0.2, 0.05), Profile(np.array([0.0, 0.07, 0.11]), np.array([0.1, 0.7, 0.3]), lag_s=0.02)):
        together = profile.at(times, tolerance_s=1e-9)
        for piece in (1, 7, 100):
            alone = [profile.at(times[k : k + piece], tolerance_s=1e-9) for k in range(0, len(times), piece)]
            assert np.array_equal(np.concatenate(alone), together)
