"""Closed loops and coupled joints of a robot in a MuJoCo model: constraints that it solves for at each step."""

from __future__ import annotations

from typing import TYPE_CHECKING

from excite.errors import InputError
from excite.robot.mechanisms.closures import Closure, Coupling, Loop, Rod
from excite.robot.robot import Robot
from excite.simulation.mjcf_shapes import mujoco_quaternion

if TYPE_CHECKING:
    import mujoco

# A mechanism gives way like its links do, that is not at all: the time constant is two steps, the least that is stable,
# and the impedance so near to one that a four-bar's torques are those of rigid links to 1e-6.
_STEPS, _IMPEDANCE = 2.0, 0.9999


def add_closures(spec: mujoco.MjSpec, bodies: list[mujoco.MjsBody], robot: Robot, timestep: float) -> None:
    """Constraints for a robot's mechanism.

    Args:
        spec: the model.
        bodies: by joint index, the world first; each body's frame is its joint's.
        robot: the robot.
        timestep: of the simulation [s].

    Raises:
        InputError: a coupling that MuJoCo has no constraint for.
    """
    for closure in () if robot.mechanism is None else robot.mechanism.closures:
        if isinstance(closure, Coupling):
            equality = _add_coupling(spec, robot, closure)
        else:
            equality = _add_loop(spec, bodies, closure)
        equality.solref = [_STEPS * timestep, 1.0]
        equality.solimp = [_IMPEDANCE, _IMPEDANCE, 0.001, 0.5, 2.0]
        equality.active = True


def _add_loop(spec: mujoco.MjSpec, bodies: list[mujoco.MjsBody], closure: Closure) -> mujoco.MjsEquality:
    import mujoco

    if not isinstance(closure, Loop | Rod):
        raise InputError("is no loop that MuJoCo has a constraint for", field=closure.name)
    names = []
    for number, (joint, place) in enumerate(zip(closure.joints, closure.placements, strict=True)):
        names.append(f"{closure.name}.end.{number}")
        bodies[joint].add_site(name=names[-1], pos=place.translation, quat=mujoco_quaternion(place.rotation))
    if isinstance(closure, Rod):
        tendon = spec.add_tendon(name=closure.name)
        for name in names:
            tendon.wrap_site(name)
        equality = spec.add_equality(
            name=closure.name,
            type=mujoco.mjtEq.mjEQ_TENDON,
            objtype=mujoco.mjtObj.mjOBJ_TENDON,
            name1=closure.name,
        )
        return equality
    kind = mujoco.mjtEq.mjEQ_WELD if closure.rigid else mujoco.mjtEq.mjEQ_CONNECT
    equality = spec.add_equality(
        name=closure.name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, name1=names[0], name2=names[1]
    )
    if closure.rigid:
        equality.data[10] = 1.0
    return equality


def _add_coupling(spec: mujoco.MjSpec, robot: Robot, closure: Coupling) -> mujoco.MjsEquality:
    import mujoco

    names = [robot.joint_names[column - robot.n_base_v] for _, column in closure.columns]
    if all(len(factors) == 1 for factors in closure.factors):
        tendon = spec.add_tendon(name=closure.name)
        for name, factors in zip(names, closure.factors, strict=True):
            tendon.wrap_joint(name, factors[0])
        equality = spec.add_equality(
            name=closure.name,
            type=mujoco.mjtEq.mjEQ_TENDON,
            objtype=mujoco.mjtObj.mjOBJ_TENDON,
            name1=closure.name,
        )
        equality.data[0] = closure.offset
        return equality
    linear = [k for k, factors in enumerate(closure.factors) if len(factors) == 1]
    if len(names) != 2 or not linear:
        raise InputError(
            "couples more than two joints by more than factors, and MuJoCo has no constraint for that",
            field=f"couplings.{closure.name}",
            remedy="couple joints two by two, one of them by a factor",
        )
    follower, master = linear[0], 1 - linear[0]
    scale = closure.factors[follower][0]
    equality = spec.add_equality(
        name=closure.name,
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=names[follower],
        name2=names[master],
    )
    values = [closure.offset / scale, *(-factor / scale for factor in closure.factors[master])]
    equality.data[: len(values)] = values
    return equality
