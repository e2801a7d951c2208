"""A robot that is not the model: true parameters, true drives and what was injected into it; and what a run leaves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from excite.arrays import Array, Flags, Indices
from excite.results import Name, Stated
from excite.robot.robot import Robot
from excite.simulation.mjcf import World
from excite.simulation.true_parameters import (
    Drives,
    TrueParameters,
    carried_load,
    has_hands,
    hrp2_like_changes,
    nominal_drives,
    nominal_truth,
    scattered_drives,
    scattered_parameters,
)

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, eq=False)
class Recording:
    """Samples of a run at the sensors' rate, in pinocchio's conventions, without noise.

    Attributes:
        name: name of the motion.
        time: ``(n,)`` [s], from the start of the motion.
        q: ``(n, nq)`` configurations.
        v: ``(n, nv)`` velocities.
        a: ``(n, nv)`` accelerations that the positions really follow.
        q_cmd: ``(n, n_joints)`` commanded joint positions.
        tau_motor: ``(n, n_joints)`` torque of the motors as delivered [N·m or N]. Viscous friction and the
            servo's damping act with the velocity at the end of the integration step.
        tau_link: ``(n, n_joints)`` torque that reaches the link: motor less friction of motor and
            gears and less what turns the rotor.
        clipped: ``(n, n_joints)`` which drives were asked for more than they give.
        contacts: by foot name, ``(n, 6)``: force, and moment about the world's origin, that the ground exerts
            on the foot, in the world frame; empty where forces were not recorded.
        wrenches: by sensor name, ``(n, 6)``: wrench on the robot through the sensor, in the sensor's frame; empty
            likewise.
        touches: ``(n,)`` number of contacts other than soles on the ground.
    """

    name: str
    time: Array
    q: Array
    v: Array
    a: Array
    q_cmd: Array
    tau_motor: Array
    tau_link: Array
    clipped: Flags
    contacts: Mapping[str, Array]
    wrenches: Mapping[str, Array]
    touches: Array


# A robot that is not the model: true parameters, true drives and what was injected into it.

# What injected physics acts on while a robot is simulated: joints by name, their friction, forces on them.


class Law(Protocol):
    """Physics that MuJoCo has no element for; has to survive pickling."""

    def start(self, plant: Plant) -> Callable[[], None]:
        """What is called before every step of a run: adds to ``plant.friction``, ``damping``, ``torque``."""


class Change(Protocol):
    """A change of the simulated machine itself; has to survive pickling."""

    def __call__(self, spec: mujoco.MjSpec) -> None:
        """Edit the specification before it is compiled."""


@dataclass(eq=False)
class Plant:
    """A compiled model, the state of a run, and what laws add to the next step.

    Attributes:
        model: MuJoCo's model.
        data: its state.
        robot: the nominal robot.
        drives: true drives.
        session_s: when the run starts within its session [s].
        memory: what laws keep from one run of a session to the next.
        qpos: index of each logged coordinate in ``data.qpos``.
        dof: index of each logged velocity in ``data.qvel``.
        friction: ``(n_joints,)`` Coulomb friction of the next step [N·m].
        damping: ``(n_joints,)`` viscous friction of the next step [N·m·s/rad].
        torque: ``(nv,)`` torques of the next step beside those of actuators [N·m].
        force: ``(n_bodies, 6)`` forces and moments on bodies at their centres of mass, world frame.
        command: torque that the drives are told to give, where it is not what they give; else None.
        touching: how many pairs of shapes that must not meet overlapped when the last sample was taken.
    """

    model: Any
    data: Any
    robot: Robot
    drives: Drives
    session_s: float = 0.0
    memory: dict[Any, Any] = field(default_factory=dict)
    qpos: Indices = field(init=False)
    dof: Indices = field(init=False)
    friction: Array = field(init=False)
    damping: Array = field(init=False)
    torque: Array = field(init=False)
    force: Array = field(init=False)
    command: Array | None = None
    touching: int = 0
    _steps: tuple[Callable[[], None], ...] = ()
    _step: Callable[..., None] = field(init=False)

    def __post_init__(self) -> None:
        import mujoco

        self._step = mujoco.mj_step
        m, base = self.model, self.robot.floating
        joints = [m.joint(name) for name in self.robot.joint_names]
        first_q, first_v = (list(range(7)), list(range(6))) if base else ([], [])
        self.qpos = np.array(first_q + [int(j.qposadr[0]) for j in joints], dtype=np.int64)
        self.dof = np.array(first_v + [int(j.dofadr[0]) for j in joints], dtype=np.int64)
        self.friction = self.drives.total_coulomb.copy()
        self.damping = self.drives.total_viscous.copy()
        self.torque = np.zeros(m.nv)
        self.force = np.zeros((m.nbody, 6))

    @property
    def joint_dof(self) -> Indices:
        """Index of each actuated joint in ``data.qvel``, ``(n_joints,)``."""
        return self.dof[self.robot.n_base_v :]

    @property
    def time(self) -> float:
        """Time since the run began to be recorded [s]; negative while the robot settles."""
        return float(self.data.time) - self.settle_s

    settle_s: float = 0.0

    def run(self, laws: tuple[Law, ...]) -> None:
        """Begin a run under these laws."""
        self._steps = tuple(law.start(self) for law in laws)

    def advance(self) -> None:
        """One step."""
        if self._steps:
            self.friction[:] = self.drives.total_coulomb
            self.damping[:] = self.drives.total_viscous
            self.torque[:] = 0.0
            self.force[:] = 0.0
            for step in self._steps:
                step()
            dof = self.joint_dof
            self.model.dof_frictionloss[dof] = np.maximum(self.friction, 0.0)
            self.model.dof_damping[dof] = np.maximum(self.damping, 0.0)
            self.data.qfrc_applied[:] = self.torque
            self.data.xfrc_applied[:] = self.force
        self._step(self.model, self.data)

    def load(self, joint: int) -> float:
        """Torque that a joint's gear carried to its link in the last step [N·m]."""
        d, i = self.data, int(self.joint_dof[joint])
        moved = d.qfrc_actuator[i] + d.qfrc_passive[i] + d.qfrc_constraint[i] + d.qfrc_applied[i]
        return float(moved - self.drives.armature[joint] * d.qacc[i])


Reading = Callable[[Recording], Recording]


@dataclass(frozen=True)
class Injected(Stated):
    """An effect that was injected, which the nominal model lacks.

    Attributes:
        effect: its name.
        location: where it sits.
        value: how much, in its unit.
        unit: of the value.
    """

    effect: Name
    location: Name
    value: float
    unit: str


@dataclass(frozen=True, eq=False)
class VirtualRobot:
    """What is simulated in place of a real robot.

    Attributes:
        robot: the nominal robot; limits, contacts and sensors of its description hold for the truth too.
        truth: true inertial parameters and what was changed to get them.
        drives: true drives.
        world: numerical settings and the ground.
        readings: what sits between the physics and the log, applied in order before noise is added; each has
            to survive pickling.
        noise: factor on the noise of every sensor; 0 for a log without noise.
        laws: injected physics that acts at every step.
        changes: injected changes of the machine itself, made before it is compiled, in order.
        injected: names, places and sizes of all that was injected, in order.
    """

    robot: Robot
    truth: TrueParameters
    drives: Drives
    world: World = field(default_factory=World)
    readings: tuple[Reading, ...] = ()
    noise: float = 1.0
    laws: tuple[Law, ...] = ()
    changes: tuple[Change, ...] = ()
    injected: tuple[Injected, ...] = ()

    def with_law(self, law: Law) -> VirtualRobot:
        """The same robot under one more law."""
        return replace(self, laws=(*self.laws, law))

    def with_change(self, change: Change) -> VirtualRobot:
        """The same robot with one more change of the machine."""
        return replace(self, changes=(*self.changes, change))

    def with_reading(self, reading: Reading) -> VirtualRobot:
        """The same robot with one more effect on what its sensors say."""
        return replace(self, readings=(*self.readings, reading))


def nominal_robot(robot: Robot) -> VirtualRobot:
    """The virtual robot that is the model: nominal parameters, declared drives."""
    return VirtualRobot(robot, nominal_truth(robot), nominal_drives(robot))


def changed_robot(robot: Robot, rng: np.random.Generator) -> VirtualRobot:
    """A virtual robot that differs from its model as a used robot does.

    A standing robot got parts added (:func:`~excite.simulation.true_parameters.hrp2_like_changes`), one without hands
    a load; any other has inertial parameters and friction scattered about the declared ones.
    """
    if robot.floating and robot.feet:
        if not has_hands(robot):
            return VirtualRobot(robot, carried_load(robot, rng), nominal_drives(robot))
        return VirtualRobot(robot, hrp2_like_changes(robot, rng), nominal_drives(robot))
    truth = scattered_parameters(robot, rng)
    return VirtualRobot(robot, truth, scattered_drives(robot, rng))
