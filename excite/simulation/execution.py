"""Run a motion on a virtual robot under its own position servo."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import MotionError
from excite.motion.motion import Motion, interpolate_motion
from excite.mujoco_warnings import has_diverged, without_log_file
from excite.robot.robot import Robot
from excite.simulation.coordinates import motion_from_mujoco, position_from_mujoco, position_to_mujoco
from excite.simulation.mjcf import build_spec, watch_shapes
from excite.simulation.sensing import sensor_wrenches
from excite.simulation.virtual_robot import Plant, Recording, VirtualRobot

if TYPE_CHECKING:
    import mujoco

SETTLE_S = 1.0

Stop = Callable[[int, Plant], bool]


class DivergedError(MotionError):
    """A simulation that has become infinite."""


def execute_motion(
    virtual: VirtualRobot,
    motion: Motion,
    *,
    stop: Stop | None = None,
    session_s: float = 0.0,
    memory: dict[Any, Any] | None = None,
    forces: bool = True,
    machine: Machine | None = None,
) -> Recording:
    """Run one motion from rest.

    The robot is put on the ground in the motion's first posture and held there for a second, then
    follows the motion's joint positions and velocities with ``kp (q_cmd - q) + kd (v_cmd - v)``, clipped at
    the torque limits, without feedforward. The integrator is semi-implicit: the torques, accelerations and
    contact forces recorded are those that the step at that instant really applied, so that they and the
    second difference of the positions satisfy the equations of motion.

    Args:
        virtual: the robot.
        motion: the motion, of the same joints.
        stop: asked at every sample with its number and the plant after the step from there; True ends the run.
        session_s: when the run starts within its session [s].
        memory: what injected physics keeps from run to run of a session, filled here.
        forces: whether contact wrenches and what sensors read of them are recorded: they take a quarter of the time.
        machine: the robot, compiled already; compiled for this run alone, if None.

    Returns:
        The recording, shorter than the motion if it was stopped.

    Raises:
        MotionError: the motion is not for this robot; DivergedError: the simulation diverged.
    """
    import mujoco

    robot = virtual.robot
    if motion.joint_names != robot.joint_names or motion.floating != robot.floating:
        raise MotionError(
            f"moves other joints than {robot.name}", source=motion.name, remedy="plan it for this robot"
        )
    clock = clock_of(virtual, motion)
    machine = Machine(virtual) if machine is None else machine
    start = position_to_mujoco(motion.q[0], floating=robot.floating)
    positions, velocities = _joint_commands(robot, motion, clock)
    kp, kd = virtual.drives.kp, virtual.drives.kd
    controls = positions + velocities * np.divide(kd, kp, out=np.zeros_like(kp), where=kp > 0.0)
    begun = start.tobytes(), controls[0].tobytes(), clock.settle
    # What laws keep is no part of the state.
    known = None if virtual.laws else machine.settled(begun)
    data = mujoco.MjData(machine.model) if known is None else known
    memory = {} if memory is None else memory
    plant = Plant(machine.model, data, robot, virtual.drives, session_s, memory, settle_s=SETTLE_S)
    track = _Track(machine, plant, clock, forces=forces)
    plant.run(virtual.laws)
    with without_log_file():
        if known is None:
            data.qpos[plant.qpos] = start
            data.ctrl[:] = controls[0]
            for _ in range(clock.settle):
                plant.advance()
            machine.remember(begun, data)
        commanded = data.ctrl
        for step in range((clock.samples - 1) * clock.per_sample + 1):
            commanded[:] = controls[step]
            if step % clock.per_sample:
                plant.advance()
                continue
            track.sample()
            if stop is not None and stop(track.count - 1, plant):
                break
    if has_diverged(data) or not np.isfinite(track.gain[: track.count]).all():
        raise DivergedError("the simulation diverged", source=motion.name, remedy="check gains and timestep")
    return track.recording(virtual, motion.name, positions[:: clock.per_sample], clock)


def _joint_commands(robot: Robot, motion: Motion, clock: Clock) -> tuple[Array, Array]:
    """Joint positions and velocities at every step; drives interpolate the commands that they receive."""
    count = (clock.samples - 1) * clock.per_sample + 1
    time = motion.time[0] + np.minimum(np.arange(count) * clock.step, motion.duration)
    # The base is not commanded.
    joints = motion.joint_positions(), motion.joint_velocities(), motion.joint_accelerations()
    fine = interpolate_motion(
        replace(motion, q=joints[0], v=joints[1], a=joints[2], contacts={}), robot, time
    )
    return fine.q, fine.v


class _Track:
    """Collects the samples of a run."""

    def __init__(self, machine: Machine, plant: Plant, clock: Clock, *, forces: bool):
        import mujoco

        self.friction_type = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)
        self.plant, self.model, self.robot, self.count = plant, plant.model, plant.robot, 0
        self.touching, self.forces = machine.touching, forces
        robot, model = self.robot, self.model
        n, joints = clock.samples, robot.n_joints
        # MuJoCo's own order, which is left once a run: taking a row out of it takes as long as a fifth of a step.
        self._place, self._speed, self._force = plant.data.qpos, plant.data.qvel, plant.data.actuator_force
        self.qpos, self.qvel, self.gain = (
            np.zeros((n, model.nq)),
            np.zeros((n, model.nv)),
            np.zeros((n, model.nv)),
        )
        self.damped = np.ones(n, dtype=bool)
        self.actuator, self.coulomb = np.zeros((n, joints)), np.zeros((n, joints))
        self.dry = bool(machine.virtual.laws) or bool((model.dof_frictionloss > 0.0).any())
        self.pushes: list[tuple[int, NDArray[np.int32], Array, Array, Array]] = []
        self.touches = np.zeros(n)
        self.foot_of_body = np.full(model.nbody, -1)
        for number, foot in enumerate(robot.feet):
            self.foot_of_body[foot.joint] = number
        self.joint_of_dof = np.zeros(model.nv, dtype=np.int64)
        self.joint_of_dof[plant.joint_dof] = np.arange(joints)

    def sample(self) -> None:
        """Take one step and record the state before it, the forces during it and which shapes overlap.

        Nobody hears of shapes that meet between two samples.
        """
        row, plant, data = self.count, self.plant, self.plant.data
        self.qpos[row], self.qvel[row] = self._place, self._speed
        plant.touching = self.touches[row] = self.touching(self._place)
        plant.advance()
        np.subtract(self._speed, self.qvel[row], out=self.gain[row])
        self.actuator[row] = self._force if plant.command is None else plant.command
        self.damped[row] = plant.command is None
        if self.dry:
            friction = data.efc_type == self.friction_type
            self.coulomb[row, self.joint_of_dof[data.efc_id[friction]]] = data.efc_force[friction]
        if self.forces:
            self._note_contacts(data, row)
        self.count += 1

    def _note_contacts(self, data: mujoco.MjData, row: int) -> None:
        """Note which soles the ground pushes, where, and how hard."""
        contact = data.contact
        soles = np.flatnonzero(contact.efc_address >= 0)
        if len(soles):
            forces = data.efc_force[contact.efc_address[soles, None] + np.arange(3)]
            self.pushes.append((row, contact.geom2[soles], contact.frame[soles], contact.pos[soles], forces))

    def _contact_wrenches(self) -> Array:
        """Wrench of the ground on each foot about the world's origin, ``(n, n_feet, 6)``."""
        wrenches = np.zeros((self.count, len(self.robot.feet), 6))
        if not self.pushes:
            return wrenches
        at, shapes, frames, places, along = (list(part) for part in zip(*self.pushes, strict=True))
        rows = np.repeat(at, [len(part) for part in shapes])
        foot = self.foot_of_body[self.model.geom_bodyid[np.concatenate(shapes)]]
        # MuJoCo orders a plane before a sphere, and the first axis of a contact's frame points from the first to the
        # second.
        axes = np.concatenate(frames).reshape(-1, 3, 3)
        force = np.einsum("kij,ki->kj", axes, np.concatenate(along))
        both = np.hstack([force, np.cross(np.concatenate(places), force)])
        np.add.at(wrenches, (rows, foot), both)
        return wrenches

    def recording(self, virtual: VirtualRobot, name: str, q_cmd: Array, clock: Clock) -> Recording:
        """The recording in pinocchio's conventions."""
        robot, n = self.robot, self.count
        drives, h, dof = virtual.drives, self.model.opt.timestep, self.plant.dof
        q = position_from_mujoco(self.qpos[:n, self.plant.qpos], floating=robot.floating)
        v, a = motion_from_mujoco(q, self.qvel[:n, dof], self.gain[:n, dof] / h, floating=robot.floating)
        v_joint, a_joint = v[:, robot.n_base_v :], a[:, robot.n_base_v :]
        # The implicit step applies velocity-dependent forces with the velocity at its end.
        clipped = np.abs(self.actuator[:n]) >= drives.torque_limit * (1.0 - 1e-12)
        # On feet damping acts as rotors do, of a clipped drive too.
        undamped = ~self.damped[:n, None] | (clipped & (not robot.feet))
        motor = self.actuator[:n] - np.where(undamped, 0.0, drives.kd * h * a_joint)
        total = drives.total_coulomb
        share = np.divide(drives.coulomb, total, out=np.zeros_like(total), where=total > 0.0)
        gears = share * self.coulomb[:n] - drives.viscous * (v_joint + h * a_joint)
        contacts, wrenches = {}, {}
        if self.forces:
            pushed = self._contact_wrenches()
            contacts = {foot.name: pushed[:, number] for number, foot in enumerate(robot.feet)}
            wrenches = sensor_wrenches(robot, virtual.truth.phi, q, v, a, contacts)
        return Recording(
            name=name,
            time=np.arange(n, dtype=np.float64) * clock.step * clock.per_sample,
            q=q,
            v=v,
            a=a,
            q_cmd=q_cmd[:n],
            tau_motor=motor,
            tau_link=motor + gears - drives.armature * a_joint,
            clipped=clipped,
            contacts=contacts,
            wrenches=wrenches,
            touches=self.touches[:n],
        )


@dataclass(frozen=True, eq=False)
class Clock:
    """Steps of the physics and of the sensors.

    Attributes:
        step: [s]
        per_sample: steps between two sensor samples.
        settle: steps before the motion starts, a multiple of ``per_sample``.
        samples: number of sensor samples.
    """

    step: float
    per_sample: int
    settle: int
    samples: int


def clock_of(virtual: VirtualRobot, motion: Motion) -> Clock:
    """The clock of a run of a motion."""
    period = 1.0 / virtual.robot.description.sensors.rate_hz
    per_sample = _steps_a_sample(virtual, period)
    samples = int(np.floor(motion.duration / period + 1e-9)) + 1
    settle = round(SETTLE_S / period) * per_sample
    return Clock(period / per_sample, per_sample, settle, samples)


def _steps_a_sample(virtual: VirtualRobot, period: float) -> int:
    return max(1, int(np.ceil(period / virtual.world.timestep - 1e-9)))


# A virtual robot compiled once, for one run or many.


# What tells one beginning of a run from others: configuration, first command, steps that it settles for.
Beginning = tuple[bytes, bytes, int]


class Machine:
    """MuJoCo's models of a virtual robot, and how it stood when it had settled last.

    Attributes:
        virtual: the robot.
        step: of its physics [s].
        model: what its physics is computed with.
    """

    def __init__(self, virtual: VirtualRobot, *, watch: bool = False) -> None:
        """Compile the robot; ``watch`` says whether it is to be known which of its shapes overlap."""
        period = 1.0 / virtual.robot.description.sensors.rate_hz
        self.virtual, self.step = virtual, period / _steps_a_sample(virtual, period)
        self.model = self._compile_model(shapes=False)
        self._watch = _Watch(self._compile_model(shapes=True)) if watch else None
        self._settled: tuple[Beginning, Any] | None = None

    def touching(self, qpos: Array) -> int:
        """How many pairs of shapes that must not meet overlap in a configuration in MuJoCo's layout."""
        return 0 if self._watch is None else self._watch.touching(qpos)

    def settled(self, start: Beginning) -> Any:
        """A copy of the state in which a run that began as ``start`` says had settled; None if it is not known."""
        if self._settled is None or self._settled[0] != start:
            return None
        return copy.copy(self._settled[1])

    def remember(self, start: Beginning, data: Any) -> None:
        """Keep the state in which a run that began as ``start`` says has settled: most motions begin at rest."""
        self._settled = (start, copy.copy(data))

    def _compile_model(self, *, shapes: bool) -> Any:
        import mujoco

        virtual = self.virtual
        spec = build_spec(
            virtual.robot, virtual.truth.phi, virtual.drives, replace(virtual.world, timestep=self.step)
        )
        for change in virtual.changes:
            change(spec)
        if shapes:
            watch_shapes(spec, virtual.robot)
        model = spec.compile()
        if virtual.robot.feet:
            _damp_as_rotors_do(model)
        if model.ntree == 1:
            # All constraints of one tree of bodies are one island: a step is the same to the last bit without a search
            # for others, and a standing G1's takes a fifteenth less time.
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
        return model


def _damp_as_rotors_do(model: Any) -> None:
    """Take the damping of servos at the end of a step, as the implicit integrator does, but for contacts as well.

    An implicit step solves ``(M + h D) a = f - D v``. MuJoCo's finds contact forces with ``M`` alone, so that soles
    creep where the damping of a step outweighs the inertia of a light foot. With ``h D`` among the rotors' inertia its
    explicit step is the same one, and contacts know of it: tilts of 38 motions of G1, R1 and H1_2 differ by less than
    1 mrad between steps of 1 and of 0.5 ms, and point feet of 27 (Go2, B2, HyQ) slip as far in 1 ms as in 0.25.
    """
    import mujoco

    dof = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    model.dof_armature[dof] -= model.opt.timestep * model.actuator_biasprm[:, 2]
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER


class _Watch:
    """Finds shapes that overlap, in a model of its own: steps of the physics take a seventh longer with 500 pairs."""

    def __init__(self, model: Any) -> None:
        import mujoco

        self._model, self._data = model, mujoco.MjData(model)
        self._place, self._collide = mujoco.mj_kinematics, mujoco.mj_collision

    def touching(self, qpos: Array) -> int:
        self._data.qpos[:] = qpos
        self._place(self._model, self._data)
        self._collide(self._model, self._data)
        return int(self._data.ncon)
