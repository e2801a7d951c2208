"""The nominal simulator with the accepted effects in it: a MuJoCo model, and notes on what XML cannot say."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.simulator.augmented_contacts import SoftPlay, add_soft_play
from excite.diagnosis.simulator.augmented_effects import DEFLECTION, FORMS, Draft, Found, presliding, tilted
from excite.diagnosis.simulator.augmented_plant import Plant, fitted_plant, physical_plant
from excite.diagnosis.simulator.model_text import AugmentedModel
from excite.diagnosis.simulator.physical_bodies import unphysical
from excite.robot.robot import Robot
from excite.simulation.drives import Drives
from excite.simulation.mjcf import World, build_spec

if TYPE_CHECKING:
    import mujoco

_TIMESTEP = 1e-3
_NO_LIMIT = 1e6


def baseline_model(baseline: Baseline) -> AugmentedModel:
    """The simulator without effects: the fitted or trusted baseline."""
    return augmented_model(baseline, ())


def augmented_model(baseline: Baseline, effects: Sequence[Found]) -> AugmentedModel:
    """The simulator with effects.

    Args:
        baseline: the baseline as fitted together with them.
        effects: the effects.

    Returns:
        The model.

    Raises:
        InputError: the robot has joints that cannot be simulated.
    """
    robot = baseline.samples.robot
    wanted, warnings = fitted_plant(baseline), []
    for item in effects:
        form = FORMS.get(item.effect)
        if form is None:
            warnings.append(formless(item))
        elif form.plant is not None:
            wanted = form.plant(wanted, robot, baseline.samples.joints, item)
    gravity = np.array(robot.model.gravity.linear)
    for item in effects:
        if item.effect == "base_tilt":
            gravity = tilted(gravity, item)
    plant = physical_plant(baseline, wanted, gravity)
    warnings += unphysical(plant.mismatch, "residual")
    draft = Draft(robot, baseline.samples.joints, _spec(robot, baseline.samples.index, plant))
    _formed(draft, baseline, effects)
    draft.spec.compile()
    return AugmentedModel(draft.spec.to_xml(), tuple(warnings))


def formless(item: Found) -> str:
    """The warning for an effect that no simulator can express."""
    return f"{item.effect} has no form in a simulator and is left out of the model"


def _formed(draft: Draft, baseline: Baseline, effects: Sequence[Found]) -> None:
    """Presliding of the baseline's friction, and what effects change in the XML."""
    for j, (joint, sign) in enumerate(zip(baseline.samples.joints, baseline.signs, strict=True)):
        if sign.bent and "coulomb_friction" in baseline.modelled:
            values = {"breakaway": sign.breakaway}
            if sign.damped:
                values |= {"damping": baseline.bristle_damping(j), "damped_below": sign.damped_below}
            presliding(draft, joint, values)
    for item in effects:
        form = FORMS.get(item.effect)
        if form is not None and form.model is not None:
            form.model(draft, item)
    for item in effects:
        if "softness" in item.values:
            names = ("softness", "stiffness", "damping")
            play = SoftPlay(0.5 * item.value("width"), *(item.value(name) for name in names))
            add_soft_play(draft.spec, item.location + DEFLECTION, play)


def _spec(robot: Robot, index: Sequence[int], plant: Plant) -> mujoco.MjSpec:
    """Bodies, friction and rotor inertia, a motor for each joint."""
    n = robot.n_joints

    def all_joints(values: Array) -> Array:
        out = np.zeros(n)
        out[list(index)] = values
        return out

    drives = Drives(
        kp=np.ones(n),
        kd=np.zeros(n),
        torque_limit=np.full(n, _NO_LIMIT),
        viscous=all_joints(plant.viscous),
        coulomb=all_joints(plant.coulomb),
        bearing_viscous=np.zeros(n),
        bearing_coulomb=np.zeros(n),
        armature=all_joints(plant.armature),
        rate_hz=1.0 / _TIMESTEP,
    )
    spec = build_spec(robot, plant.phi, drives, World(timestep=_TIMESTEP))
    bias = all_joints(plant.bias)
    for number, name in enumerate(robot.joint_names):
        motor = spec.actuator(name)
        motor.forcelimited = False
        motor.gainprm[0] = 1.0
        motor.biasprm[:3] = [-bias[number], 0.0, 0.0]
        # Positions are the record's: a range would push where the model's is narrower.
        spec.joint(name).limited = False
    return spec
