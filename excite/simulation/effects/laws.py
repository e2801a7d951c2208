"""Laws of friction, force and drives in a virtual robot: each makes a function that is called at every step."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.simulation.coordinates import body_name
from excite.simulation.virtual_robot import Plant

if TYPE_CHECKING:
    import mujoco


Step = Callable[[], None]


@dataclass(frozen=True)
class AsymmetryLaw:
    """Coulomb friction larger by ``change`` [N·m] in the positive direction and smaller by it in the other."""

    joint: int
    change: float

    def start(self, plant: Plant) -> Step:
        """The law on a plant: what is called before every step of the physics."""
        j, i = self.joint, int(plant.joint_dof[self.joint])

        def apply_law() -> None:
            plant.friction[j] += self.change if plant.data.qvel[i] > 0.0 else -self.change

        return apply_law


@dataclass(frozen=True)
class LoadFrictionLaw:
    """``coefficient · |torque that the gear carries|`` more dry friction."""

    joint: int
    coefficient: float

    def start(self, plant: Plant) -> Step:
        """The law on a plant: what is called before every step of the physics."""

        def apply_law() -> None:
            plant.friction[self.joint] += self.coefficient * abs(plant.load(self.joint))

        return apply_law


@dataclass(frozen=True)
class StribeckLaw:
    """``excess · exp(−(|v|/velocity)^exponent)`` more dry friction at low speed (Bo, Pavelescu 1982)."""

    joint: int
    excess: float  # static less Coulomb friction [N·m]
    velocity: float  # Stribeck velocity [rad/s]
    exponent: float = 2.0  # 0.5 … 2

    def start(self, plant: Plant) -> Step:
        """The law on a plant: what is called before every step of the physics."""
        j, i = self.joint, int(plant.joint_dof[self.joint])

        def apply_law() -> None:
            speed = abs(plant.data.qvel[i]) / self.velocity
            plant.friction[j] += self.excess * math.exp(-(speed**self.exponent))

        return apply_law


@dataclass(frozen=True)
class WarmingLaw:
    """Friction times ``1 + change · T`` with a temperature T that goes from 0 towards 1 over a session."""

    joint: int
    change: float  # relative change once warm
    time_constant: float  # of the warming [s]
    heated: bool = False  # T' = (power/usual power − T)/time_constant, instead of time alone
    viscous_only: bool = False  # the oil changes and the dry part stays

    def start(self, plant: Plant) -> Step:
        """The law on a plant: what is called before every step of the physics."""
        j, i = self.joint, int(plant.joint_dof[self.joint])
        dry, oil = float(plant.drives.total_coulomb[j]), float(plant.drives.total_viscous[j])
        usual = dry * 0.5 + oil * 0.25
        key, step_s = ("temperature", j), float(plant.model.opt.timestep)
        cool = plant.session_s - plant.memory.get((*key, "left"), 0.0)
        state = plant.memory.get(key, 0.0) * math.exp(-max(cool, 0.0) / self.time_constant)

        def apply_law() -> None:
            nonlocal state
            if self.heated:
                v = abs(plant.data.qvel[i])
                state += step_s * ((dry * v + oil * v * v) / usual - state) / self.time_constant
                plant.memory[key] = state
                plant.memory[(*key, "left")] = plant.session_s + plant.time
            else:
                state = -math.expm1(-(plant.session_s + max(plant.time, 0.0)) / self.time_constant)
            factor = self.change * state
            plant.damping[j] += factor * oil
            if not self.viscous_only:
                plant.friction[j] += factor * dry

        return apply_law


# Laws of torques at a joint and forces on a link: each makes a function that is called at every simulation step.


@dataclass(frozen=True)
class PushLaw:
    """A constant force on a link's centre of mass along the world's axes."""

    link: str
    force: tuple[float, float, float]  # [N]

    def start(self, plant: Plant) -> Step:
        """The law on a plant: what is called before every step of the physics."""
        body = plant.model.body(body_name(self.link)).id

        def apply_law() -> None:
            plant.force[body, :3] += self.force

        return apply_law


@dataclass(frozen=True)
class SpringLaw:
    """``−stiffness (x + hardening x³)`` about a rest position, and dry rubbing of the hose itself."""

    joint: int
    stiffness: float  # at rest [N·m/rad]
    rest: float = 0.0  # position at which it is slack [rad]
    hardening: float = 0.0  # [1/rad²]
    rubbing: float = 0.0  # torque of an elasto-plastic element in parallel [N·m]; it yields over 0.1 rad

    def start(self, plant: Plant) -> Step:
        """The law on a plant: what is called before every step of the physics."""
        base = plant.robot.n_base_q
        at, i = int(plant.qpos[base + self.joint]), int(plant.joint_dof[self.joint])
        drag, last = 0.0, float(plant.data.qpos[at])

        def apply_law() -> None:
            nonlocal drag, last
            q = float(plant.data.qpos[at])
            x = q - self.rest
            torque = self.stiffness * x * (1.0 + self.hardening * x * x)
            if self.rubbing:
                drag = min(max(drag + (q - last) / 0.1 * self.rubbing, -self.rubbing), self.rubbing)
                last = q
            plant.torque[i] -= torque + drag

        return apply_law


@dataclass(frozen=True)
class RippleLaw:
    """``(amplitude + load_share·|load|) (sin(n q + phase) + second·sin(2 n q))`` against the drive."""

    joint: int
    amplitude: float  # [N·m]
    periods: float  # a revolution of the joint
    phase: float = 0.0  # [rad]
    load_share: float = 0.0  # part that grows with the load on the gear
    second: float = 0.0  # share of the second harmonic

    def start(self, plant: Plant) -> Step:
        """The law on a plant: what is called before every step of the physics."""
        at = int(plant.qpos[plant.robot.n_base_q + self.joint])
        i = int(plant.joint_dof[self.joint])

        def apply_law() -> None:
            angle = self.periods * float(plant.data.qpos[at])
            size = self.amplitude
            if self.load_share:
                size += self.load_share * abs(plant.load(self.joint))
            wave = math.sin(angle + self.phase) + self.second * math.sin(2.0 * angle)
            plant.torque[i] -= size * wave

        return apply_law


@dataclass(frozen=True)
class TouchLaw:
    """An upward force on a link's centre of mass that comes and goes smoothly every ``period``."""

    link: str
    force: float  # at most [N]
    period: float = 2.0  # [s]; the contact lasts half of it

    def start(self, plant: Plant) -> Step:
        """The law on a plant: what is called before every step of the physics."""
        body = plant.model.body(body_name(self.link)).id

        def apply_law() -> None:
            wave = math.sin(2.0 * math.pi * plant.time / self.period) if plant.time > 0.0 else 0.0
            plant.force[body, 2] += self.force * max(wave, 0.0)

        return apply_law


# Laws of gears and drives: a second joint between rotor and link, a lag between command and torque.

_SUFFIX = ".deflection"


@dataclass(frozen=True)
class LooseGear:
    """Splits a joint into the motor's and the deflection of the link behind it."""

    joint: str
    rotor: float  # inertia of the rotor where the drive has none [kg·m²]

    def __call__(self, spec: mujoco.MjSpec) -> None:
        motor = spec.joint(self.joint)
        if motor.armature <= 0.0:
            motor.armature = self.rotor
        motor.parent.add_joint(
            name=self.joint + _SUFFIX, type=motor.type, axis=motor.axis.copy(), pos=motor.pos.copy()
        )


@dataclass(frozen=True)
class GearLaw:
    """Torque across the gear: a dead band of ±half_gap, then a spring that may harden, and a damper."""

    joint: str
    stiffness: float  # beyond the dead band [N·m/rad]
    damping: float  # [N·m·s/rad], within the dead band none
    half_gap: float = 0.0  # half the play [rad]
    hardening: float = 0.0  # relative growth of the stiffness with the square of the deflection [1/rad²]

    def start(self, plant: Plant) -> Step:
        """The law on a plant: what is called before every step of the physics."""
        joint = plant.model.joint(self.joint + _SUFFIX)
        at, i = int(joint.qposadr[0]), int(joint.dofadr[0])

        def apply_law() -> None:
            x = float(plant.data.qpos[at])
            beyond = x - self.half_gap if x > self.half_gap else min(x + self.half_gap, 0.0)
            if not beyond:
                return
            spring = self.stiffness * beyond * (1.0 + self.hardening * beyond * beyond)
            pull = spring + self.damping * float(plant.data.qvel[i])
            # A contact pushes and does not pull.
            if self.half_gap and pull * beyond < 0.0:
                pull = 0.0
            plant.torque[i] -= pull

        return apply_law


@dataclass(frozen=True)
class CoupledMotor:
    """Dry friction of a motor that turns with the joint before its own as well, as many wrists' motors do."""

    joint: str
    before: str
    coulomb: float  # [N·m]

    def __call__(self, spec: mujoco.MjSpec) -> None:
        tendon = spec.add_tendon(name=f"{self.joint}.motor", frictionloss=self.coulomb)
        tendon.wrap_joint(self.joint, 1.0)
        tendon.wrap_joint(self.before, 1.0)


def disconnect_servos(spec: mujoco.MjSpec) -> None:
    """Servos without force of their own: the law computes their command and delivers it."""
    for actuator in spec.actuators:
        actuator.gainprm[0] = 0.0
        actuator.biasprm[:3] = 0.0


@dataclass(frozen=True)
class LagLaw:
    """Delivered torque follows the command through one or two equal first-order filters."""

    time_constant: float  # of each filter [s]
    order: int = 1  # 1 or 2

    def start(self, plant: Plant) -> Step:
        """The law on a plant: what is called before every step of the physics."""
        drives, base = plant.drives, plant.robot.n_base_q
        at, dof = plant.qpos[base:], plant.joint_dof
        share = -np.expm1(-float(plant.model.opt.timestep) / self.time_constant)
        states: list[Any] = [None] * self.order

        def apply_law() -> None:
            d = plant.data
            command = drives.kp * (d.ctrl - d.qpos[at]) - drives.kd * d.qvel[dof]
            command = np.clip(command, -drives.torque_limit, drives.torque_limit)
            value = command
            for k in range(self.order):
                states[k] = value.copy() if states[k] is None else states[k] + share * (value - states[k])
                value = states[k]
            plant.command = command
            plant.torque[dof] += value

        return apply_law
