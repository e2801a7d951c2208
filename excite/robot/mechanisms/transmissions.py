"""Motors that drive joints together, over rods or gears: massless cranks in the model, tied to what they move.

A motor of a parallel ankle or a differential has no link of its own in most URDFs. It gets one here, without mass, and
a joint with its name, limits, friction and rotor; the joints that it moves follow. So everything that is said of
mechanisms holds for it: motors' positions from joints' and back, and ``τ_m = Gᵀ τ``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated
from xml.etree import ElementTree

from pydantic import Field, model_validator

from excite.errors import RobotError
from excite.robot.mechanisms.blocks import CouplingBlock, LoopBlock, LoopEnd
from excite.robot.per_joint import Block, Name, Source
from excite.robot.quantities import JointValue, Ratio, Torque, Vector3, Velocity

# So little that no motion shows it, and more than the 1e-15 that MuJoCo asks of a moving body [kg, kg·m²].
_MASS, _INERTIA = 1e-8, 1e-12


class MotorBlock(Block):
    """A motor on a link: its crank and rod, or the ratios of its gears to the joints.

    ``crank`` goes from the motor's axis to the rod's ball at the motor's zero, in the link's axes; ``rod`` is its other
    ball. ``ratios``: turns of the motor per turn of each joint.
    """

    name: Name
    link: Name
    xyz: Vector3 = (0.0, 0.0, 0.0)
    axis: Vector3 = (0.0, 0.0, 1.0)
    crank: Vector3 | None = None
    rod: LoopEnd | None = None
    ratios: dict[str, Ratio] = Field(default_factory=dict)
    position: tuple[JointValue, JointValue]
    velocity: Velocity
    torque: Torque

    @model_validator(mode="after")
    def _one_way(self) -> MotorBlock:
        if (self.rod is None) != (self.crank is None) or (self.rod is None) == (not self.ratios):
            raise ValueError(f"motor {self.name} has either crank and rod, or ratios")
        if not any(self.axis):
            raise ValueError(f"motor {self.name} has an axis of length zero")
        return self


class TransmissionBlock(Block):
    """Joints that as many motors drive together, and these motors."""

    name: Name
    joints: Annotated[tuple[Name, ...], Field(min_length=1)]
    motors: Annotated[tuple[MotorBlock, ...], Field(min_length=1)]
    source: Source

    @model_validator(mode="after")
    def _as_many(self) -> TransmissionBlock:
        if len(self.motors) != len(self.joints):
            raise ValueError(
                f"transmission {self.name} has {len(self.motors)} motors for {len(self.joints)} joints"
            )
        return self


def add_motors(root: ElementTree.Element, blocks: tuple[TransmissionBlock, ...], path: Path) -> None:
    """Give motors a joint and a link each in a ``robot`` element.

    Raises:
        RobotError: a motor sits on no link, or has the name of a joint.
    """
    links = {link.get("name", "") for link in root.findall("link")}
    joints = {joint.get("name", "") for joint in root.findall("joint")}
    for block in blocks:
        for motor in block.motors:
            field = f"transmissions.{block.name}.{motor.name}"
            if motor.name in joints:
                raise RobotError(
                    "is the name of a joint already",
                    source=path,
                    field=field,
                    remedy="give the motor its own",
                )
            if motor.link not in links:
                raise RobotError(
                    f"no link {motor.link!r}",
                    source=path,
                    field=f"{field}.link",
                    remedy="the model has " + ", ".join(sorted(links)),
                )
            _add_motor(root, motor)


def _add_motor(root: ElementTree.Element, motor: MotorBlock) -> None:
    link = ElementTree.SubElement(root, "link", name=crank_link(motor))
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "mass", value=repr(_MASS))
    moments = dict.fromkeys(("ixx", "iyy", "izz"), repr(_INERTIA))
    ElementTree.SubElement(inertial, "inertia", {**moments, **dict.fromkeys(("ixy", "ixz", "iyz"), "0")})
    joint = ElementTree.SubElement(root, "joint", name=motor.name, type="revolute")
    ElementTree.SubElement(joint, "parent", link=motor.link)
    ElementTree.SubElement(joint, "child", link=crank_link(motor))
    ElementTree.SubElement(joint, "origin", xyz=_format_row(motor.xyz), rpy="0 0 0")
    ElementTree.SubElement(joint, "axis", xyz=_format_row(motor.axis))
    lower, upper = motor.position
    ElementTree.SubElement(
        joint,
        "limit",
        lower=repr(lower),
        upper=repr(upper),
        velocity=repr(motor.velocity),
        effort=repr(motor.torque),
    )


def crank_link(motor: MotorBlock) -> str:
    """Name of a motor's link."""
    return f"{motor.name}_crank"


def closures_of(
    blocks: tuple[TransmissionBlock, ...],
) -> tuple[tuple[LoopBlock, ...], tuple[CouplingBlock, ...]]:
    """Loops and couplings that transmissions amount to."""
    loops: list[LoopBlock] = []
    couplings: list[CouplingBlock] = []
    for block in blocks:
        passive = block.joints
        for motor in block.motors:
            name = f"{block.name}.{motor.name}"
            if motor.rod is not None and motor.crank is not None:
                end = LoopEnd(link=crank_link(motor), xyz=motor.crank)
                loops.append(
                    LoopBlock(
                        name=name, kind="rod", ends=(end, motor.rod), passive=passive, source=block.source
                    )
                )
            else:
                ratios = {joint: -ratio for joint, ratio in motor.ratios.items()}
                joints: dict[str, float | tuple[float, ...]] = {motor.name: 1.0, **ratios}
                couplings.append(
                    CouplingBlock(name=name, joints=joints, passive=passive, source=block.source)
                )
            passive = ()
    return tuple(loops), tuple(couplings)


def _format_row(values: tuple[float, ...]) -> str:
    return " ".join(repr(float(value)) for value in values)
