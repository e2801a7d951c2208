"""How each effect enters a MuJoCo model: in its inertials and drives, in its XML, or as a note for the runner.

Sizes are those that a diagnosis states; nothing here looks at the columns that they were fitted by.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.horizontal import level_axes
from excite.diagnosis.simulator.augmented_plant import Plant
from excite.diagnosis.simulator.model_text import NOTE
from excite.robot.links import carried_link
from excite.robot.robot import Robot

if TYPE_CHECKING:
    import mujoco

DEFLECTION = ".deflection"
PRESLIDING = "presliding"
_LEAST_ROTOR = 1e-4
_TEN = ("mass", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")


@dataclass(frozen=True)
class Found:
    """An accepted effect with its sizes.

    Attributes:
        effect: its name.
        location: its place.
        values: its parameters, SI.
    """

    effect: str
    location: str
    values: Mapping[str, float]

    def value(self, name: str, missing: float = 0.0) -> float:
        """One of its parameters."""
        return float(self.values.get(name, missing))


@dataclass(frozen=True, eq=False)
class Draft:
    """A model in the making.

    Attributes:
        robot: the robot.
        joints: joints with torque.
        spec: the specification.
    """

    robot: Robot
    joints: tuple[str, ...]
    spec: mujoco.MjSpec

    def note(self, item: Found, *names: str) -> None:
        """Leave the effect to the runner; sizes that it does not have are left out."""
        data = " ".join(f"{name}={item.value(name):.9g}" for name in names if name in item.values)
        self.spec.add_text(name=f"{NOTE}.{item.effect}.{item.location}", data=data)


PlantForm = Callable[[Plant, Robot, tuple[str, ...], Found], Plant]
ModelForm = Callable[[Draft, Found], None]


@dataclass(frozen=True)
class Form:
    """An effect's form in a simulator.

    Attributes:
        plant: its part in inertial parameters, friction and rotor inertia.
        model: its part in the XML.
        noted: whether the runner has to apply it.
    """

    plant: PlantForm | None = None
    model: ModelForm | None = None
    noted: bool = field(default=False)


def _drive(field_name: str, parameter: str) -> PlantForm:
    def form(plant: Plant, robot: Robot, joints: tuple[str, ...], item: Found) -> Plant:
        values: Array = getattr(plant, field_name).copy()
        values[joints.index(item.location)] += item.value(parameter)
        changed: dict[str, Any] = {field_name: values}
        return replace(plant, **changed)

    return form


def _body(plant: Plant, robot: Robot, joints: tuple[str, ...], item: Found) -> Plant:
    links = [carried_link(robot.model, k) for k in range(1, robot.model.njoints)]
    k = links.index(item.location)
    phi = plant.phi.copy()
    phi[10 * k : 10 * k + 10] += [item.value(name) for name in _TEN]
    return replace(plant, phi=phi)


def _rubbing(plant: Plant, robot: Robot, joints: tuple[str, ...], item: Found) -> Plant:
    """Bristles do not push: where a fit has them do so, the joint has less dry friction."""
    less = min(item.value("rubbing"), 0.0)
    return _drive("coulomb", "level")(plant, robot, joints, replace(item, values={"level": less}))


def _spring(draft: Draft, item: Found) -> None:
    joint, stiffness = draft.spec.joint(item.location), item.value("stiffness")
    joint.stiffness = [stiffness, 0.0, 0.0]
    joint.springref = -item.value("torque_at_zero") / stiffness
    if {"quadratic", "cubic"} & set(item.values):
        bristles = ("rubbing", "breakaway") if item.value("rubbing") > 0.0 else ()
        draft.note(item, "quadratic", "cubic", *bristles)


def _dry(draft: Draft, item: Found) -> None:
    if "breakaway" in item.values:
        presliding(draft, item.location, {"breakaway": item.value("breakaway")})


def presliding(draft: Draft, joint: str, values: Mapping[str, float]) -> None:
    """Leave to the runner that a joint's dry friction builds up over a deflection: ``breakaway`` [rad].

    Where that is damped, by how much (``damping`` [N·m·s]) and up to which speed (``damped_below`` [rad/s]).
    """
    draft.note(Found(PRESLIDING, joint, values), "breakaway", "damping", "damped_below")


def _gain(draft: Draft, item: Found) -> None:
    motor, gain = draft.spec.actuator(item.location), 1.0 + item.value("gain_error")
    motor.gainprm[0] /= gain
    motor.biasprm[0] /= gain


def _offset(draft: Draft, item: Found) -> None:
    draft.spec.joint(item.location).ref = item.value("offset")
    if "in_log_only" in item.values:
        draft.note(item, "in_log_only")


def _lag(draft: Draft, item: Found) -> None:
    import mujoco

    # A second-order lag T₂² τ̈ + T τ̇ + τ = u as two filters in series, as like as they can be where it rings.
    total, square = item.value("time_constant"), item.value("second_order")
    root = float(np.sqrt(max(0.25 * total**2 - square, 0.0)))
    slow, fast = 0.5 * total + root, 0.5 * total - root
    for name in draft.joints:
        motor = draft.spec.actuator(name)
        motor.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
        # The filter's at the step's end: a command is half a step old, and so is the velocity that a servo sees.
        motor.dynprm[0], motor.actearly = slow, True
    if square > 0.0:
        draft.note(replace(item, values={"before": fast}), "before")


def _length(draft: Draft, item: Found) -> None:
    body = _moved_body(draft, item.location)
    body.pos = body.pos + np.array([item.value(f"shift_{axis}") for axis in "xyz"])


def tilted(gravity: Array, item: Found) -> Array:
    """Gravity ``(3,)`` in a tilted base [m/s²]: its components are along the axes that the effect is fitted in."""
    size, (first, second, down) = float(np.linalg.norm(gravity)), level_axes(gravity)
    aside = item.value("gravity_x") * first + item.value("gravity_y") * second
    # A tilt turns gravity, it does not add to it; but masses that were fitted beside what is left of it go with that.
    less = float(np.sqrt(max(size**2 - float(aside @ aside), 0.0))) - size
    return (size + item.value("gravity_down", less)) * down + aside


def _tilt(draft: Draft, item: Found) -> None:
    draft.spec.option.gravity = tilted(np.array(draft.spec.option.gravity), item)
    ripple = {name: item.value(f"first_row_{name}") for name in ("cosine", "sine")}
    first = Found("base_tilt", draft.joints[0], ripple | {"periods_per_rev": 1.0})
    draft.note(first, "cosine", "sine", "periods_per_rev")


def _soft(draft: Draft, item: Found) -> None:
    """A second joint of the same body behind the motor's, whose rotor alone the armature is."""
    stiffness, damping = item.value("stiffness"), item.value("damping")
    # MuJoCo's polynomial: force −(k₀ + k₁ |x| + k₂ x²) x.
    harder = stiffness / item.value("hardening_at") ** 2 if "hardening_at" in item.values else 0.0
    _behind(draft, item).stiffness = [stiffness, 0.0, harder]
    draft.spec.joint(item.location + DEFLECTION).damping = [damping, 0.0, 0.0]
    draft.note(item, "stiffness", "hardening_at")


def _loose(draft: Draft, item: Found) -> None:
    """A second joint with a range as wide as the play; its stops have the contact's frequency and damping."""
    joint = _behind(draft, item)
    draft.note(item, "width", "softness", "stiffness")
    if "softness" in item.values:
        return
    half = 0.5 * item.value("width")
    joint.limited, joint.range = True, [-half, half]
    ratio = item.value("damping_ratio", 1.0)
    joint.solref_limit = [1.0 / (2.0 * np.pi * item.value("contact_hz", 20.0) * ratio), ratio]
    joint.solimp_limit = [0.99, 0.99, 0.001, 0.5, 2.0]


def _behind(draft: Draft, item: Found) -> mujoco.MjsJoint:
    motor = draft.spec.joint(item.location)
    motor.armature = max(motor.armature, _LEAST_ROTOR)
    return _moved_body(draft, item.location).add_joint(
        name=item.location + DEFLECTION, type=motor.type, axis=motor.axis
    )


def _moved_body(draft: Draft, joint: str) -> mujoco.MjsBody:
    return next(b for b in draft.spec.bodies if any(j.name == joint for j in b.joints))


def _noted(*names: str) -> Form:
    return Form(model=lambda draft, item: draft.note(item, *names), noted=True)


FORMS: dict[str, Form] = {
    "viscous_friction": Form(plant=_drive("viscous", "coefficient")),
    "coulomb_friction": Form(plant=_drive("coulomb", "level"), model=_dry),
    "armature": Form(plant=_drive("armature", "inertia")),
    "torque_bias": Form(plant=_drive("bias", "bias")),
    "coulomb_asymmetry": Form(plant=_drive("bias", "bias")),
    "payload": Form(plant=_body),
    "link_inertia": Form(plant=_body),
    "joint_spring": Form(plant=_rubbing, model=_spring),
    "torque_gain": Form(model=_gain),
    "encoder_offset": Form(model=_offset),
    "actuator_lag": Form(model=_lag),
    "link_length_error": Form(model=_length),
    "base_tilt": Form(model=_tilt, noted=True),
    "joint_elasticity": Form(model=_soft),
    "backlash": Form(model=_loose),
    "stribeck": _noted("excess", "velocity", "exponent", "presliding", "breakaway", "bristle_damping"),
    "load_dependent_friction": _noted("coefficient"),
    "friction_drift": _noted(
        "coulomb_change", "viscous_change", "time_constant", "session_end", "in_each_trial"
    ),
    "torque_ripple": _noted(
        "cosine", "sine", "periods_per_rev", "cosine_2", "sine_2", "cosine_load", "sine_load"
    ),
    "time_delay": _noted("delay"),
}
