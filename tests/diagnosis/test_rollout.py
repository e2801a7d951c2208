"""The runner of augmented models against closed forms, and the plant that a simulator accepts."""

from __future__ import annotations

import numpy as np
import pytest

from excite.diagnosis.effects.bodies import tilt_gravity
from excite.diagnosis.effects.bristle import Bristle, StaticFriction
from excite.diagnosis.effects.forces import RubbingSpring
from excite.diagnosis.effects.form import Sizes
from excite.diagnosis.equations.dry_friction.friction_sign import RATIO, bend_bristle, bend_further
from excite.diagnosis.simulator.rollout import Drive, Simulator, Window, WindowHistory
from excite.errors import InputError

INERTIA = 0.5
MODEL = """
<mujoco><compiler angle="radian"/><option gravity="0 0 0" integrator="implicitfast"/><worldbody><body>
<inertial pos="0 0 0" mass="1" diaginertia="{i} {i} {i}"/><joint name="j" axis="0 0 1" {joint}/></body></worldbody>
<actuator><general name="j" joint="j" biastype="affine" {motor}/></actuator><custom>{notes}</custom></mujoco>
"""


def simulator(joint: str = "", motor: str = "", **notes: str) -> Simulator:
    texts = "".join(f'<text name="excite.{k}.j" data="{v}"/>' for k, v in notes.items())
    texts = texts.replace("time_delay.j", "time_delay.torque").replace(
        "actuator_lag.j", "actuator_lag.torque"
    )
    return Simulator(MODEL.format(i=INERTIA, joint=joint, motor=motor, notes=texts), ("j",))


def window(q: float = 0.0, v: float = 0.0, duration: float = 1.0, session_s: float = 0.0, **more) -> Window:
    time = np.arange(0.0, duration, 1e-3)
    return Window(np.array([q]), np.array([v]), np.array([0.0]), time, session_s, **more)


def constant(torque: float) -> Drive:
    return Drive(np.array([0.0, 10.0]), np.full((2, 1), torque))


def test_free_joint_follows_the_parabola():
    path = simulator().run_window(window(v=0.0), constant(2.0), 1000)
    assert path[-1, 0] == pytest.approx(0.5 * 2.0 / INERTIA, rel=2e-3)


def test_stribeck_friction_slows_by_its_value_at_the_speed():
    excess, velocity, speed = 0.4, 0.2, 0.1
    friction = excess * np.exp(-((speed / velocity) ** 2))
    # A dry friction already in the model makes MuJoCo's constraint; the note adds to it.
    sim = simulator('frictionloss="0.001"', stribeck=f"excess={excess} velocity={velocity}")
    path = sim.run_window(window(v=speed, duration=0.05), constant(0.001 + friction), 10)
    assert np.diff(path[:, 0]) == pytest.approx(np.full(len(path) - 1, speed * 0.01), rel=0.02)


def test_drift_uses_the_session_clock_or_what_it_is_told():
    note = "coulomb_change=0.3 viscous_change=0 time_constant=1000000 session_end=100"
    sim = simulator('frictionloss="0.1"', friction_drift=note)
    held = sim.run_window(window(session_s=100.0), constant(0.35), 1000)
    moving = sim.run_window(window(session_s=0.0), constant(0.35), 1000)
    told = sim.run_window(window(session_s=0.0, growth={"j": 1.0}), constant(0.35), 1000)
    assert abs(held[-1, 0]) < 1e-3 and abs(told[-1, 0]) < 1e-3
    assert moving[-1, 0] == pytest.approx(0.5 * 0.25 / INERTIA, rel=0.02)


def test_bristles_bend_before_they_slip_and_remember_the_past():
    """A joint held below the level is a spring of level/breakaway; beyond it, it slips against the level."""
    level, breakaway, push = 0.5, 0.02, 0.2
    sim = simulator(f'frictionloss="{level}"', presliding=f"breakaway={breakaway}")
    stiffness = level / breakaway
    damped = simulator(f'frictionloss="{level}" damping="5"', presliding=f"breakaway={breakaway}")
    held = damped.run_window(window(duration=3.0), constant(push), 1000)[-1, 0]
    # z = x/δ while hardly anything slips: Dahl's z = 1 − exp(−x/δ) to all orders.
    assert held == pytest.approx(-breakaway * np.log(1.0 - push / level), rel=0.01)
    assert held == pytest.approx(push / stiffness, rel=0.4)
    slipping = sim.run_window(window(v=1.0, duration=0.4), constant(level + 0.3), 100)
    assert np.diff(slipping[:, 0], 2)[-1] == pytest.approx(0.3 / INERTIA * 0.01, rel=0.02)
    # Bent all the way by the past, it drives the joint back with its level.
    time = np.linspace(-1.0, 0.0, 201)
    past = WindowHistory(time, np.zeros((201, 1)), np.ones((201, 1)))
    back = sim.run_window(window(duration=0.01, past=past), constant(0.0), 10)
    assert back[-1, 0] == pytest.approx(-0.5 * level / INERTIA * 0.01**2, rel=0.15)


def test_bristles_are_damped_at_low_speed_alone():
    """A carriage on a bent bristle that never slips is a damped spring: its decrement tells the damping."""
    level, breakaway, damping = 50.0, 0.5, 2.0
    stiffness, push = level / breakaway, 0.5
    note = f"breakaway={breakaway} damping={damping}"
    swing = simulator(f'frictionloss="{level}"', presliding=note).run_window(
        window(duration=2.0), constant(push), 1
    )[:, 0]
    turn = np.sqrt(stiffness / INERTIA)
    decay = 0.5 * damping / breakaway / INERTIA
    time = np.arange(len(swing)) * 1e-3
    rest = push / stiffness
    ringing = np.sqrt(complex(turn**2 - decay**2))
    wave = (np.cos(ringing * time) + decay / ringing * np.sin(ringing * time)).real
    assert swing == pytest.approx(rest * (1.0 - np.exp(-decay * time) * wave), abs=0.03 * rest)
    fading = simulator(f'frictionloss="{level}"', presliding=note + " damped_below=1e-6")
    free = simulator(f'frictionloss="{level}"', presliding=f"breakaway={breakaway}")
    first, last = (sim.run_window(window(duration=2.0), constant(push), 1)[:, 0] for sim in (fading, free))
    assert first == pytest.approx(last, abs=0.01 * rest)


def test_stribeck_with_bristles_takes_over_its_share_of_the_level():
    excess, velocity, speed, level = 0.3, 0.2, 0.1, 0.4
    note = f"excess={excess} velocity={velocity} presliding={level} breakaway=0.0005"
    sim = simulator(f'frictionloss="{level}"', stribeck=note)
    time = np.linspace(-1.0, 0.0, 201)
    past = WindowHistory(time, np.zeros((201, 1)), np.full((201, 1), speed))
    friction = level + excess * np.exp(-((speed / velocity) ** 2))
    path = sim.run_window(window(v=speed, duration=0.05, past=past), constant(friction), 10)
    assert np.diff(path[:, 0]) == pytest.approx(np.full(len(path) - 1, speed * 0.01), rel=0.02)


@pytest.mark.parametrize("damping", [0.0, 0.006])
def test_static_friction_bends_bristles_in_a_roll_out_as_in_a_fit(damping: float):
    level, step = 0.4, 1e-3
    static = StaticFriction(excess=0.3, velocity=0.06, exponent=1.6)
    bristle = Bristle(2e-3, damping, 0.05, static)
    v = 0.15 * np.sin(np.arange(3000) * step * 7.0) + 0.05 * np.sin(np.arange(3000) * step * 23.0)
    made = []
    for speed in v[:, None]:
        torque, viscous = bristle.friction_force(np.array([level]), speed, step)
        bristle.advance_deflection(speed, step)
        made.append(-float((torque - viscous * speed)[0]))
    starts = np.arange(len(v)) == 0
    plain = bend_bristle(v, starts, step, 2e-3)
    further = bend_further(v, starts, step, 2e-3, static.velocity, static.exponent, RATIO)
    friction = level * plain + static.excess * (further - plain) / RATIO
    rate = np.diff(friction, prepend=0.0) / step * np.exp(-((v / 0.05) ** 2))
    assert np.array(made) == pytest.approx(friction + damping / level * rate, abs=1e-9)


def test_bristles_take_no_more_than_there_is_of_a_level():
    """Where they bend like those of the baseline, a fit may give them any share: together they are the level."""
    level, speed = 0.3, 0.2
    note = f"excess=0.1 velocity=0.02 presliding={40.0 * level} breakaway=0.0005"
    sim = simulator(f'frictionloss="{level}"', stribeck=note, presliding="breakaway=0.0005")
    past = WindowHistory(np.linspace(-1.0, 0.0, 201), np.zeros((201, 1)), np.full((201, 1), speed))
    path = sim.run_window(window(v=speed, duration=0.05, past=past), constant(level), 10)
    assert np.diff(path[:, 0]) == pytest.approx(np.full(len(path) - 1, speed * 0.01), rel=0.02)


def test_a_lag_starts_from_what_the_record_asked_before():
    motor = 'dyntype="filterexact" dynprm="0.1" gainprm="1"'
    time = np.linspace(0.0, 2.0, 401)
    ramp = Drive(time, time[:, None])
    past = WindowHistory(time[:201], np.zeros((201, 1)), np.zeros((201, 1)))
    steps = np.arange(1.0, 1.2, 1e-3)
    start = Window(np.zeros(1), np.zeros(1), np.zeros(1), steps, 0.0, {}, past)
    path = simulator(motor=motor).run_window(start, ramp, 200)
    # A ramp through a lag is the ramp, later by the time constant.
    expected = (0.9 * 0.2**2 / 2.0 + 0.2**3 / 6.0) / INERTIA
    assert path[-1, 0] == pytest.approx(expected, rel=0.01)


def test_a_servo_behind_a_lag_is_as_damped_as_its_equation():
    """A lightly damped one, at a coarse step: a delay of one step more would make it ring ever louder."""
    kp, kd, lag, step = 2000.0, 50.0, 0.02, 1.25e-3
    motor = f'dyntype="filterexact" dynprm="{lag}" gainprm="1" actearly="true"'
    clock = np.arange(0.0, 1.0, step)
    held = np.zeros((len(clock), 1))
    servo = Drive(clock, held, *np.array([[kp], [kd]]))
    past = WindowHistory(np.linspace(-1.0, 0.0, 201), np.ones((201, 1)), np.zeros((201, 1)))
    # Velocities belong half a step before positions.
    before = np.array([0.5 * step * kp / INERTIA])
    start = Window(np.ones(1), before, np.zeros(1), clock, 0.0, {}, past)
    path = simulator(motor=motor).run_window(start, servo, 1)
    # q̈ = f/I, ḟ = (−kp q − kd q̇ − f)/T, from where the torque has long been what is asked for.
    law = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0 / INERTIA], [-kp / lag, -kd / lag, -1.0 / lag]])
    values, vectors = np.linalg.eig(law)
    first = np.linalg.solve(vectors, np.array([1.0, 0.0, -kp]))
    times = step * np.arange(len(path))
    expected = ((vectors[0] * first) @ np.exp(np.outer(values, times))).real
    assert values.real.max() < 0.0
    assert np.abs(path[:, 0] - expected).max() < 0.1


def test_a_servo_reads_what_the_log_does_not():
    time = np.arange(0.0, 3.0, 1e-3)
    zeros = np.zeros((3000, 1))
    servo = Drive(time, zeros, *np.array([[40.0], [9.0]]))
    off = simulator(encoder_offset="in_log_only=0.2").run_window(window(duration=2.9), servo, 2900)
    # It goes where its own reading is what was asked for.
    assert off[-1, 0] == pytest.approx(0.2, abs=1e-3)
    pushed = constant(2.0)
    there = simulator(encoder_offset="in_log_only=0.2").run_window(window(), pushed, 1000)
    assert there == pytest.approx(simulator().run_window(window(), pushed, 1000))


def test_ripple_spring_and_bias_balance_a_torque():
    sim = simulator(torque_ripple="cosine=0.7 sine=0 periods_per_rev=8")
    still = sim.run_window(window(), constant(0.7), 100)
    assert np.abs(still).max() < 1e-6
    sim = simulator(joint_spring="quadratic=2 cubic=4")
    at = sim.run_window(window(q=0.5), constant(2 * 0.25 + 4 * 0.125), 100)
    assert np.abs(at - 0.5).max() < 1e-6


def test_a_late_channel_is_read_later_and_a_servo_has_no_channel():
    time = np.arange(0.0, 2.0, 1e-3)
    step = Drive(time, (time[:, None] >= 0.5).astype(float))
    late, prompt = simulator(time_delay="delay=0.2"), simulator()
    moved = [s.run_window(window(duration=0.5), step, 500)[-1, 0] for s in (late, prompt)]
    assert moved[0] == pytest.approx(0.5 * 0.2**2 / INERTIA, rel=0.02)
    assert abs(moved[1]) < 1e-6
    servo = Drive(time, np.full((2000, 1), 40.0), *np.array([[40.0], [9.0]]))
    a, b = (s.run_window(window(), servo, 100) for s in (late, prompt))
    assert np.array_equal(a, b)


def test_stiff_servo_damping_is_stable_and_right():
    """A light joint, damped far beyond what an explicit step bears, follows its closed form."""
    time = np.arange(0.0, 1.0, 1e-3)
    zeros = np.zeros((1000, 1))
    servo = Drive(time, zeros + 2000.0, np.array([2000.0]), np.array([2000.0]))
    path = simulator().run_window(window(), servo, 100)
    # Overdamped: the slow pole is kp/kd = 1/s.
    assert path[:, 0] == pytest.approx(1.0 - np.exp(-np.arange(len(path)) * 0.1), abs=2e-3)


@pytest.mark.parametrize("angle", [0.0, 0.05, 0.4])
def test_a_tilt_turns_gravity_by_its_angle(angle: float):
    """It keeps its size, however steep the tilt."""
    level, aside = np.array([0.0, 0.0, -9.81]), 9.81 * np.sin(angle)
    turned = tilt_gravity(level, Sizes("base", {"gravity_x": 0.6 * aside, "gravity_y": -0.8 * aside}))
    assert np.linalg.norm(turned) == pytest.approx(9.81)
    assert turned[:2] == pytest.approx([0.6 * aside, -0.8 * aside])


def test_gravity_that_masses_were_fitted_beside_is_what_they_were_fitted_beside():
    values = {"gravity_x": 0.3, "gravity_y": 0.4, "gravity_down": -0.2}
    turned = tilt_gravity(np.array([0.0, 0.0, -9.81]), Sizes("base", values))
    assert turned[2] == pytest.approx(-9.61)
    assert np.hypot(*turned[:2]) == pytest.approx(0.5)


@pytest.mark.parametrize("notes", [{}, {"stribeck": "excess=0.1 velocity=0.1"}])
def test_a_run_that_diverges_ends_in_what_is_not_finite(notes, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = simulator('frictionloss="0.001"', **notes).run_window(window(), constant(9e9), 100)
    assert len(path) == 11 and not np.isfinite(path[-1]).any()
    assert not list(tmp_path.iterdir())


def test_rubbing_that_a_fit_has_push_is_less_dry_friction():
    for rubbing, more in ((-0.1, -0.1), (0.1, 0.0)):
        values = {"stiffness": 1.0, "quadratic": 0.0, "cubic": 0.0, "rubbing": rubbing, "breakaway": 0.01}
        form = RubbingSpring().in_mujoco(Sizes("j", values))
        assert form.coulomb == pytest.approx(more)
        assert form.notes[0].note.has_friction == (rubbing > 0.0)


@pytest.mark.parametrize(
    ("word", "text"),
    [
        ("sticktion", "excess=1"),
        ("stribeck", "excess=1"),
        ("stribeck", "fast"),
        ("time_delay", "delay=1 late=2"),
    ],
)
def test_a_note_that_nobody_can_follow_is_no_silence(word: str, text: str):
    with pytest.raises(InputError, match=f"excite.{word}."):
        simulator(**{word: text})
