"""The nominal simulator of a standing robot with the accepted effects in it: a MuJoCo model, and notes beside it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.diagnosis.floating.effects.form import StandingNote
from excite.diagnosis.floating.equations.problem import Problem
from excite.diagnosis.floating.equations.state import State
from excite.diagnosis.floating.search.refinement import Fitted, apply_all
from excite.diagnosis.floating.simulator.noted import write_note
from excite.diagnosis.simulator.model_text import AugmentedModel, refused
from excite.diagnosis.simulator.physical_bodies import PhysicalBodies, nearest_bodies, unphysical
from excite.robot.robot import Robot
from excite.simulation.coordinates import body_name
from excite.simulation.drives import Drives, nominal_drives
from excite.simulation.mjcf import World, build_spec
from excite.simulation.mjcf_shapes import mujoco_quaternion

if TYPE_CHECKING:
    import mujoco

_NO_LIMIT = 1e6
_TIMESTEP = 1e-3


def standing_model(problem: Problem, fitted: Fitted) -> AugmentedModel:
    """The simulator with a fit's inertial parameters and effects.

    Args:
        problem: the problem.
        fitted: the fit; without effects it gives the nominal simulator.

    Raises:
        InputError: MuJoCo takes no such model.
    """
    state = apply_all(problem.state(fitted.delta), fitted.placed, fitted.theta)
    phi, mismatch = _physical(problem, state)
    try:
        spec = build_spec(_with_lengths(problem.record.robot, state), phi, _drives(problem), World(_TIMESTEP))
        spec.option.gravity = problem.record.tree.gravity
        _add_sensors(spec, problem, state.placements)
        for number, (item, theta) in enumerate(zip(fitted.placed, fitted.theta, strict=True)):
            form = item.effect.in_mujoco(problem.nominal, item.location, theta)
            if isinstance(form, StandingNote):
                write_note(spec, number, form)
        spec.compile()
    except ValueError as error:
        raise refused(error) from error
    return AugmentedModel(spec.to_xml(), unphysical(mismatch, "noise"))


def _physical(problem: Problem, state: State) -> tuple[Array, float]:
    """Parameters of bodies that can exist, and by how many times the noise they are off the fitted ones (RMS)."""
    nominal = problem.record.tree.phi
    massive = np.repeat(nominal[::10] > 0.0, 10)
    bodies = PhysicalBodies(nominal[massive], np.zeros(0))
    wish = bodies.coordinates(state.phi[massive])
    if bodies.holds(wish):
        return state.phi, 0.0
    rows = problem.whitening(state.regressor)[:, massive] @ bodies.map
    found, off = nearest_bodies(bodies, rows, wish, bodies.coordinates(nominal[massive]))
    phi = state.phi.copy()
    phi[massive] = bodies.map @ found
    return phi, off


def _with_lengths(robot: Robot, state: State) -> Robot:
    """The robot with its joints where a state has them."""
    model = robot.model.copy()
    for joint in range(1, model.njoints):
        model.jointPlacements[joint] = pin.SE3(state.tree.rotations[joint], state.tree.translations[joint])
    return replace(robot, model=model)


def _drives(problem: Problem) -> Drives:
    """The robot's own; gains and limits that it does not state are zero and none."""
    drives = nominal_drives(problem.record.robot)
    return replace(
        drives,
        kp=np.nan_to_num(drives.kp),
        kd=np.nan_to_num(drives.kd),
        torque_limit=np.nan_to_num(drives.torque_limit, nan=_NO_LIMIT, posinf=_NO_LIMIT),
    )


def _add_sensors(spec: mujoco.MjSpec, problem: Problem, placements: dict[str, pin.SE3]) -> None:
    """A site for each sensor, where its readings are expressed; of plates in the world."""
    robot = problem.record.robot
    for sensor in robot.sensors:
        body = spec.body(body_name(robot.segments[sensor.joint - 1].link)) if sensor.joint else spec.worldbody
        placement = placements[sensor.name]
        body.add_site(name=sensor.name, pos=placement.translation, quat=mujoco_quaternion(placement.rotation))
