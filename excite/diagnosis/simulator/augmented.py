"""The nominal simulator with the accepted effects in it: a MuJoCo model, and notes on what XML cannot say."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.form import Draft, Form
from excite.diagnosis.effects.friction.build_up import PRESLIDING, BuildUp
from excite.diagnosis.effects.note import Noted
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.own_columns import COULOMB
from excite.diagnosis.simulator.augmented_plant import Plant, physical_plant, plant_with
from excite.diagnosis.simulator.found import Found
from excite.diagnosis.simulator.model_text import AugmentedModel
from excite.diagnosis.simulator.notes import write_note
from excite.diagnosis.simulator.physical_bodies import unphysical
from excite.errors import InputError
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
        InputError: the robot has joints that cannot be simulated, or MuJoCo refuses the bodies.
    """
    robot = baseline.samples.robot
    joints = baseline.samples.joints
    forms = [item.form(joints) for item in effects]
    wanted = plant_with(baseline, ((item.location, form) for item, form in zip(effects, forms, strict=True)))
    plant = physical_plant(baseline, wanted, _turned(np.array(robot.model.gravity.linear), forms))
    warnings = [said for item in effects if (said := item.formless) is not None]
    warnings += unphysical(plant.mismatch, "residual")
    draft = Draft(joints, _spec(robot, baseline.samples.index, plant))
    draft.spec.option.gravity = _turned(np.array(draft.spec.option.gravity), forms)
    for noted in _presliding(baseline):
        write_note(draft.spec, noted)
    for form in forms:
        if form.elements is not None:
            form.elements(draft)
        for noted in form.notes:
            write_note(draft.spec, noted)
    for form in forms:
        if form.finish is not None:
            form.finish(draft)
    try:
        draft.spec.compile()
    except ValueError as error:
        said = " ".join(str(error).split())
        raise InputError(
            f"MuJoCo refuses the fitted model ({said})", remedy="judge by the torques"
        ) from error
    return AugmentedModel(draft.spec.to_xml(), tuple(warnings))


def _turned(gravity: Array, forms: Sequence[Form]) -> Array:
    """Gravity ``(3,)`` as effects turn it [m/s²]."""
    for form in forms:
        gravity = gravity if form.gravity is None else form.gravity(gravity)
    return gravity


def _presliding(baseline: Baseline) -> list[Noted]:
    """What is noted of the baseline's own friction: where it builds up over a deflection."""
    if not COULOMB.asked(baseline.modelled):
        return []
    noted = []
    for j, (joint, sign) in enumerate(zip(baseline.samples.joints, baseline.signs, strict=True)):
        if sign.bent:
            damped = (baseline.bristle_damping(j), sign.damped_below) if sign.damped else (None, None)
            noted.append(Noted(PRESLIDING, joint, BuildUp(sign.breakaway, *damped)))
    return noted


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
