"""Roll-outs of soft and loose gears begin as the gears swing, not at rest under their load."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from excite.diagnosis.effects.form import Draft, Sizes
from excite.diagnosis.effects.gears.gear_effect import JointElasticity
from excite.diagnosis.simulator.augmented_plant import write_note
from excite.diagnosis.simulator.rollout import Drive, Simulator, Window

ROTOR, LINK, STIFFNESS = 0.2, 0.5, 100.0
MODEL = f"""
<mujoco><compiler angle="radian"/><option gravity="0 0 0" timestep="0.001" integrator="implicitfast"/><worldbody>
<body name="b"><inertial pos="0 0 0" mass="1" diaginertia="{LINK} {LINK} {LINK}"/>
<joint name="j" axis="0 0 1" armature="{ROTOR}"/></body></worldbody>
<actuator><general name="j" joint="j" biastype="affine"/></actuator></mujoco>
"""


def softened() -> mujoco.MjSpec:
    """The model with a soft gear, as the effect writes it."""
    draft = Draft(("j",), mujoco.MjSpec.from_string(MODEL))
    form = JointElasticity().in_mujoco(Sizes("j", {"stiffness": STIFFNESS, "damping": 0.0}))
    assert form.elements is not None
    form.elements(draft)
    for noted in form.notes:
        write_note(draft.spec, noted)
    draft.spec.compile()
    return draft.spec


def test_a_link_that_swings_on_its_gear_takes_the_motor_along():
    spec = softened()
    angle, speed, clock = 0.05, 0.4, np.arange(0.0, 1.0, 1e-3)
    none = np.zeros(1)
    window = Window(none, none, none, clock, 0.0, deflected={"j": (angle, speed)})
    free = Drive(np.array([0.0, 2.0]), np.zeros((2, 1)))
    found = Simulator(spec.to_xml(), ("j",)).run_window(window, free, 10)[:, 0]
    # Both together keep their momentum while they swing against each other.
    t = 0.01 * np.arange(len(found))
    w = np.sqrt(STIFFNESS * (1.0 / ROTOR + 1.0 / LINK))
    apart = angle * np.cos(w * t) + speed / w * np.sin(w * t)
    motor = LINK / (ROTOR + LINK) * (angle - apart + speed * t)
    np.testing.assert_allclose(found, motor, atol=0.02 * np.ptp(motor))


def test_a_gear_of_which_nothing_is_told_rests_under_its_load():
    spec = softened()
    load = np.array([4.0])
    window = Window(np.zeros(1), np.zeros(1), load, np.array([0.0, 1e-3]), 0.0)
    simulator = Simulator(spec.to_xml(), ("j",))
    simulator.run_window(window, Drive(np.array([0.0, 1.0]), np.tile(load, (2, 1))), 1)
    deflected = float(simulator.runs[0].qpos[1])
    assert deflected == pytest.approx(-4.0 / STIFFNESS, rel=0.01)
