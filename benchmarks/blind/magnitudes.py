"""How large each effect is where it is hidden, and which injector puts it there."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.blind.arm_case import Arm
from benchmarks.blind.documents import HiddenEffect
from benchmarks.blind.laws import BristleLaw, GripLaw, HoseLaw, PokeLaw, PulseLaw, StopLaw
from excite.simulation.effects.laws import (
    AsymmetryLaw,
    GearLaw,
    LagLaw,
    LoadFrictionLaw,
    LooseGear,
    RippleLaw,
    SpringLaw,
    StribeckLaw,
    WarmingLaw,
    disconnect_servos,
)
from excite.simulation.effects.readings import Shift, Tilt
from excite.simulation.effects.registry import INJECTED_EFFECTS
from excite.simulation.true_parameters import AddedPart, with_part
from excite.simulation.virtual_robot import Law, VirtualRobot

Hidden = tuple[VirtualRobot, HiddenEffect]

DRIVE_FIELDS = {"viscous_friction": "viscous", "coulomb_friction": "coulomb", "armature": "armature"}
# Effects that their injector takes as they are.
WITHOUT_FORMS = ("torque_gain", "torque_bias", "encoder_offset", "time_delay", "link_inertia")
WHOLE = {"time_delay": "torque", "actuator_lag": "torque", "base_tilt": "base"}


@dataclass(frozen=True, eq=False)
class Site:
    """Where an effect is hidden, in what form, and what its magnitude is measured by."""

    virtual: VirtualRobot
    arm: Arm
    effect: str
    form: str
    joint: int
    size: float
    sign: float
    rng: np.random.Generator

    @property
    def name(self) -> str:
        """Name of the joint."""
        return self.virtual.robot.joint_names[self.joint]

    @property
    def link(self) -> str:
        """Link that the joint moves."""
        return self.virtual.robot.segments[self.joint].link

    @property
    def torque(self) -> float:
        """Typical torque of the joint over the motions [N·m]."""
        return float(self.arm.torque[self.joint])

    @property
    def dry(self) -> float:
        """Coulomb friction of the joint [N·m]."""
        return float(self.virtual.drives.coulomb[self.joint])

    def found(self, value: float, place: str | None = None, **details: float) -> HiddenEffect:
        """What is hidden here, at the joint unless another place is given."""
        numbers = {name: float(x) for name, x in details.items()}
        return HiddenEffect(self.effect, place or self.name, float(value), self.form, numbers)

    def under(self, law: Law, value: float, **details: float) -> Hidden:
        """The robot with a law added to it, and what that hides."""
        return self.virtual.with_law(law), self.found(value, None, **details)


def _own_term(s: Site) -> Hidden:
    """The one joint that has what ``modelled`` leaves out; the others have none."""
    field = DRIVE_FIELDS[s.effect]
    full = getattr(s.virtual.drives, field)
    value = full[s.joint] * max(s.size, 0.5)
    # A rotor is never weightless.
    rest = 1e-3 * full if field == "armature" else np.zeros_like(full)
    virtual = s.virtual
    if s.form == "bristle":
        virtual = virtual.with_law(BristleLaw(s.joint, value, breakaway=s.rng.uniform(1e-3, 4e-3)))
    else:
        rest[s.joint] = value
    return replace(virtual, drives=replace(virtual.drives, **{field: rest})), s.found(value)


def _hide_asymmetry(s: Site) -> Hidden:
    value = s.sign * min(s.size, 1.0) * s.rng.uniform(0.4, 0.8) * s.dry
    return s.under(AsymmetryLaw(s.joint, value), value)


def _hide_stribeck(s: Site) -> Hidden:
    value, speed = s.size * s.rng.uniform(0.7, 1.5) * s.dry, s.rng.uniform(0.03, 0.12)
    if s.form == "bristle":
        return s.under(
            BristleLaw(s.joint, s.dry, value, speed, s.rng.uniform(1e-3, 3e-3)), value, velocity=speed
        )
    power = {"plain": 2.0, "exponent_1": 1.0, "exponent_0.5": 0.5}[s.form]
    return s.under(StribeckLaw(s.joint, value, speed, power), value, velocity=speed)


def _load_friction(s: Site) -> Hidden:
    value = s.size * s.rng.uniform(0.06, 0.14)
    return s.under(LoadFrictionLaw(s.joint, value), value)


def _hide_drift(s: Site) -> Hidden:
    change = s.sign * min(s.size, 1.2) * s.rng.uniform(0.35, 0.6) * (1.0 if s.sign < 0.0 else 1.5)
    change *= 2.0 if s.form == "oil" and s.sign > 0.0 else 1.0
    seconds = s.rng.uniform(20.0, 120.0)
    law = WarmingLaw(s.joint, change, seconds, s.form == "heated", s.form == "oil")
    return s.under(law, change, time_constant=seconds)


def _hide_gear(s: Site) -> Hidden:
    """Soft or loose; damping is measured by the inertia that the gear itself moves."""
    link = float(s.arm.inertia[s.joint])
    rotor = float(s.virtual.drives.armature[s.joint])
    soft = s.effect == "joint_elasticity"
    hertz = s.rng.uniform(3.0, 6.0) / math.sqrt(s.size) if soft else s.rng.uniform(12.0, 25.0)
    stiffness = link * (2.0 * math.pi * hertz) ** 2
    ratio = s.rng.uniform(0.05, 0.2) if soft else s.rng.uniform(0.3, 0.8)
    damping = 2.0 * ratio * math.sqrt(stiffness * link * rotor / (link + rotor))
    loose = s.virtual.with_change(LooseGear(s.name, rotor))
    loose = replace(loose, world=replace(loose.world, timestep=5e-4))
    if soft:
        bend = 2.0 * s.torque / stiffness
        hard = 1.0 / bend**2 if s.form == "hardening" else 0.0
        return loose.with_law(GearLaw(s.name, stiffness, damping, 0.0, hard)), s.found(stiffness, hz=hertz)
    width = s.size * s.rng.uniform(0.012, 0.03)
    stiffness *= 0.3 if s.form == "soft" else 1.0
    return loose.with_law(GearLaw(s.name, stiffness, damping, 0.5 * width)), s.found(width, hz=hertz)


def _hide_spring(s: Site) -> Hidden:
    value = s.size * s.rng.uniform(0.3, 0.6) * s.torque
    rest = float(s.arm.motions[0].q[0, s.joint] + s.rng.uniform(-0.5, 0.5))
    hard = 1.0 if s.form == "hardening" else 0.0
    rub = 0.1 * value if s.form == "rubbing" else 0.0
    return s.under(SpringLaw(s.joint, value, rest, hard, rub), value)


def _hide_ripple(s: Site) -> Hidden:
    value, periods = s.size * s.rng.uniform(0.08, 0.2) * s.torque, float(s.rng.integers(8, 45))
    share = value / max(float(s.arm.load[s.joint]), 1e-6) if s.form == "load" else 0.0
    size, second = value * (s.form != "load"), 0.4 * (s.form == "harmonics")
    law = RippleLaw(s.joint, size, periods, s.rng.uniform(0.0, 6.28), share, second)
    return s.under(law, value, periods=periods)


def _hide_lag(s: Site) -> Hidden:
    """A servo with it keeps its distance from where it would ring (Routh's criterion for one joint by itself)."""
    order = 2 if s.form == "second_order" else 1
    kp, kd = s.virtual.drives.kp, s.virtual.drives.kd
    inertia = s.arm.inertia + s.virtual.drives.armature
    most = kd / kp if order == 1 else inertia * kd / (0.5 * kd**2 + 2.0 * inertia * kp)
    value = min(s.size * s.rng.uniform(0.3, 0.5), 0.6) * float(np.min(most))
    return s.virtual.with_change(disconnect_servos).with_law(LagLaw(value, order)), s.found(value, "torque")


def _hide_tilt(s: Site) -> Hidden:
    value, heading = s.size * s.rng.uniform(0.04, 0.09), s.rng.uniform(0.0, 2.0 * math.pi)
    return s.virtual.with_change(Tilt(value, heading)), s.found(value, "base", heading=heading)


def _hide_length_error(s: Site) -> Hidden:
    way = s.rng.standard_normal(3)
    value = s.size * s.rng.uniform(0.02, 0.05)
    x, y, z = (float(part) for part in value * way / np.linalg.norm(way))
    return s.virtual.with_change(Shift(s.name, (x, y, z))), s.found(value)


def _hide_payload(s: Site) -> Hidden:
    value = s.size * s.rng.uniform(0.03, 0.08) * s.virtual.robot.mass
    centre = s.virtual.robot.model.inertias[s.joint + 1].lever + s.rng.uniform(-0.05, 0.05, 3)
    x, y, z = (float(part) for part in centre)
    part = AddedPart("payload", s.joint, s.link, value, (x, y, z), (0.06, 0.06, 0.1))
    return replace(s.virtual, truth=with_part(s.virtual.truth, part)), s.found(value, s.link)


def _hide_unknown(s: Site) -> Hidden:
    if s.form == "push":
        value = s.size * 0.4 * s.torque
        return s.under(PokeLaw(s.joint, value, int(s.rng.integers(1 << 30))), value)
    if s.form == "pulses":
        value, period = s.size * 0.8 * s.torque, s.rng.uniform(0.7, 2.5)
        return s.under(PulseLaw(s.joint, value, period, s.rng.uniform(0.1, 0.3)), value, period=period)
    if s.form == "hose" and s.virtual.robot.n_joints > 1:
        value = s.size * 0.4 * s.torque
        other = (s.joint + int(s.rng.integers(1, s.virtual.robot.n_joints))) % s.virtual.robot.n_joints
        hose = HoseLaw(s.joint, other, value, s.rng.uniform(2.0, 4.0), s.rng.uniform(0.0, 6.28))
        return s.under(hose, value, other=other)
    if s.form == "grip":
        value = s.size * 1.2 * s.dry
        grip = GripLaw(s.joint, value, s.rng.uniform(0.4, 1.5), int(s.rng.integers(1 << 30)))
        return s.under(grip, value)
    q = np.concatenate([motion.q[:, s.joint] for motion in s.arm.motions])
    edge = float(np.quantile(q, s.rng.uniform(0.75, 0.85)))
    value = s.size * 3.0 * s.torque / max(float(q.max()) - edge, 0.05)
    return s.under(StopLaw(s.joint, edge, value), value)


def _hide_registered(s: Site) -> Hidden:
    value = {
        "torque_gain": lambda: 1.0 + s.sign * s.size * s.rng.uniform(0.08, 0.22),
        "torque_bias": lambda: s.sign * s.size * s.rng.uniform(0.5, 2.5) * s.dry,
        "encoder_offset": lambda: s.sign * s.size * s.rng.uniform(0.02, 0.08),
        "time_delay": lambda: s.size * s.rng.uniform(0.006, 0.02),
        "link_inertia": lambda: s.sign * min(s.size * s.rng.uniform(0.25, 0.5), 0.8),
    }[s.effect]()
    place = WHOLE.get(s.effect, s.link if s.effect == "link_inertia" else s.name)
    return INJECTED_EFFECTS[s.effect].inject(s.virtual, place, float(value)), s.found(value, place)


MAKERS: dict[str, Callable[[Site], Hidden]] = {
    **dict.fromkeys(WITHOUT_FORMS, _hide_registered),
    **dict.fromkeys(DRIVE_FIELDS, _own_term),
    "coulomb_asymmetry": _hide_asymmetry,
    "stribeck": _hide_stribeck,
    "load_dependent_friction": _load_friction,
    "friction_drift": _hide_drift,
    "backlash": _hide_gear,
    "joint_elasticity": _hide_gear,
    "joint_spring": _hide_spring,
    "torque_ripple": _hide_ripple,
    "actuator_lag": _hide_lag,
    "base_tilt": _hide_tilt,
    "link_length_error": _hide_length_error,
    "payload": _hide_payload,
    "unknown": _hide_unknown,
}
