"""Soft play in a simulator's XML against its law, integrated apart from MuJoCo."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import expit

from excite.diagnosis.effects.form import DEFLECTION, Draft, Sizes
from excite.diagnosis.effects.gears.backlash import Backlash, SoftBacklash, SoftPlay
from excite.diagnosis.simulator.augmented_plant import write_note
from excite.diagnosis.simulator.rollout import Drive, Simulator, Window

INERTIA, WEIGHT, VISCOUS = 0.5, 4.0, 0.3
PENDULUM = """
<mujoco><compiler angle="radian"/><option gravity="0 0 -10" timestep="0.001" integrator="implicitfast"/><worldbody>
<body name="b"><inertial pos="0 0 -0.4" mass="1" diaginertia="{about} {about} {about}"/>
<joint name="j" axis="0 1 0" damping="{viscous}" armature="{rotor}"/></body></worldbody>
<actuator><general name="j" joint="j" biastype="affine"/></actuator></mujoco>
"""


def play_of(width: float, hertz: float, softness: float) -> SoftPlay:
    omega = 2.0 * np.pi * hertz
    return SoftPlay(0.5 * width, softness, INERTIA * omega**2, 2.0 * INERTIA * omega)


def law(play: SoftPlay, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Torque of the two contacts, and the share of them that is on."""
    up, down = (x - play.half) / play.softness, (-x - play.half) / play.softness
    held = play.softness * (np.logaddexp(0.0, up) - np.logaddexp(0.0, down))
    return play.stiffness * held, expit(up) + expit(down)


def written(play: SoftPlay, hertz: float, rotor: float, *, soft: bool) -> str:
    about = INERTIA - 0.4**2
    spec = mujoco.MjSpec.from_string(PENDULUM.format(about=about, viscous=VISCOUS, rotor=rotor))
    values = {"width": 2.0 * play.half, "contact_hz": hertz}
    if soft:
        values |= {"softness": play.softness, "stiffness": play.stiffness, "damping": play.damping}
    form, draft = (SoftBacklash() if soft else Backlash()).in_mujoco(Sizes("j", values)), Draft(("j",), spec)
    for change in (form.elements, form.finish):
        if change is not None:
            change(draft)
    for noted in form.notes:
        write_note(spec, noted)
    spec.compile()
    return spec.to_xml()


def swing(play: SoftPlay, rotor: float, start: float, time: np.ndarray) -> np.ndarray:
    """The motor's angle under :func:`push`: rotor and pendulum as two bodies with the law between them."""

    def change(t: float, y: np.ndarray) -> list[float]:
        q, x, speed, relative = y
        torque, on = law(play, x)
        carried = torque + play.damping * on * relative
        motor = (push(t) - VISCOUS * speed + carried) / rotor
        return [speed, relative, motor, (-carried - WEIGHT * np.sin(q + x)) / INERTIA - motor]

    first = [start, -play.resting_deflection(WEIGHT * np.sin(start)), 0.0, 0.0]
    return solve_ivp(change, (0.0, time[-1]), first, t_eval=time, method="Radau", rtol=1e-7, atol=1e-9).y[0]


def push(t: float | np.ndarray) -> float | np.ndarray:
    return 3.0 * np.sin(2.0 * np.pi * 1.3 * t)


PLAYS = [
    (0.016, 20.0, 0.002, 0.3),
    (0.03, 10.0, 0.01, 0.05),
    (0.016, 20.0, 0.0004, 0.05),
    (0.004, 40.0, 0.004, 1e-4),
]


@pytest.mark.parametrize(("width", "hertz", "softness", "rotor"), PLAYS)
def test_a_soft_play_swings_as_its_law_does_and_a_hard_one_does_not(width, hertz, softness, rotor):
    play, start, clock = play_of(width, hertz, softness), 0.3, np.arange(0.0, 1.0, 1e-3)
    fine = np.arange(0.0, 1.1, 2e-4)
    drive = Drive(fine, push(fine)[:, None])
    load = np.array([WEIGHT * np.sin(start)])
    window = Window(np.array([start]), np.zeros(1), load, clock, 0.0)
    expected = swing(play, rotor, start, 0.01 * np.arange(100))
    soft, hard = (
        Simulator(written(play, hertz, rotor, soft=form), ("j",)).run_window(window, drive, 10)[:100, 0]
        - expected
        for form in (True, False)
    )
    assert np.ptp(expected) > 0.3
    assert np.sqrt(np.mean(soft**2)) < 5e-4
    assert np.sqrt(np.mean(soft**2)) < 0.7 * np.sqrt(np.mean(hard**2))


@pytest.mark.parametrize("ratio", [0.005, 0.4, 4.0, 200.0])
def test_hard_contacts_add_up_to_the_soft_ones_torque(ratio):
    play = SoftPlay(0.004, 0.004 / ratio, 2000.0, 0.0)
    at = play.hard_contacts(8)
    x = np.linspace(0.0, play.half + 10.0 * play.softness, 300)
    share = (1.0 - play.middle_stiffness_share) / len(at)
    torque = play.stiffness * (
        play.middle_stiffness_share * x + share * np.maximum(x[:, None] - at, 0.0).sum(axis=1)
    )
    error = np.abs(torque - law(play, x)[0]) / (play.stiffness * play.softness)
    assert (np.diff(at) > 0.0).all() and at[0] > 0.0
    assert error.max() < 0.06
    assert error[-1] < 1e-3


@pytest.mark.parametrize("softness", [2e-5, 0.001, 0.02])
def test_it_rests_where_the_law_balances_the_load(softness):
    play = SoftPlay(0.004, softness, 2000.0, 0.0)
    for torque in (-40.0, -0.3, 0.0, 1e-6, 7.0):
        assert law(play, np.array(play.resting_deflection(torque)))[0] == pytest.approx(torque, abs=1e-9)


def test_a_hard_play_is_a_range():
    model = mujoco.MjModel.from_xml_string(written(play_of(0.016, 20.0, 0.002), 20.0, 0.05, soft=False))
    joint = model.joint("j" + DEFLECTION)
    assert (model.ntendon, model.neq) == (0, 0)
    assert joint.range == pytest.approx([-0.008, 0.008])
    assert model.jnt_solref[joint.id] == pytest.approx([1.0 / (40.0 * np.pi), 1.0], rel=1e-4)
    assert model.jnt_solimp[joint.id] == pytest.approx([0.99, 0.99, 0.001, 0.5, 2.0])
