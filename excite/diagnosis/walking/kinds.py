"""What can differ in a robot that walks: effects with their sizes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.diagnosis.answer.candidate import Candidate, Estimate
from excite.regressor.tree import read_tree
from excite.robot.robot import Robot

SURE = 4.0
"""Deviations that a size has to be off by."""


@dataclass(frozen=True)
class Kind:
    """An effect of one drive, of all commands, of the IMU.

    Attributes:
        term: of the equations.
        effect: its name.
        parameter: of its size.
        unit: of the size.
        spread: standard deviation expected beforehand; of friction as a share of the joint's torque.
        least: sizes below matter to no simulator, likewise.
        usual: size where nothing is wrong.
    """

    term: str
    effect: str
    parameter: str
    unit: str
    spread: float
    least: float
    usual: float = 0.0

    def make_candidate(
        self, place: str, value: float, std: float, *, usual: float | None = None
    ) -> Candidate:
        """The effect with its size; its evidence is that of a normal likelihood, against the usual size."""
        off = (value - (self.usual if usual is None else usual)) / max(std, 1e-12)
        size = {self.parameter: Estimate(float(value), float(std), self.unit)}
        return Candidate(self.effect, place, size, float(min(0.5 * off**2, 1e6)), 0.0, 0.0, (place,))


# By drive term (:data:`~excite.rows.drive_terms.DRIVE_TERMS`). Least sizes are what drives of one robot differ by from
# another's of its make: gains by some per cent, zeros by a degree.
ROW_KINDS = {
    kind.term: kind
    for kind in (
        Kind("gain", "torque_gain", "gain_error", "1", 0.3, 0.06),
        Kind("encoder", "encoder_offset", "offset", "rad", 0.05, 0.015),
        Kind("coulomb", "coulomb_friction", "level", "N·m", 0.2, 0.05),
        Kind("viscous", "viscous_friction", "coefficient", "N·m·s/rad", 0.2, 0.05),
        Kind("offset", "torque_bias", "bias", "N·m", 0.2, 0.05),
        Kind("late", "actuator_lag", "time_constant", "s", 0.02, 0.003),
        # Rotors are the model's: no drive's own is named.
        Kind("armature", "armature", "inertia", "kg·m²", 0.02, np.inf),
    )
}
TURNED = Kind("turned", "imu_mounting", "turn", "rad", 0.05, 0.02)
LATE_IMU = Kind("late", "imu_delay", "delay", "s", 0.01, 0.004)
# Sizes of a servo's law, in the order in which it tells them.
SERVO_KINDS = (
    Kind("kp", "servo_gain", "gain", "1", 0.0, 0.05, 1.0),
    Kind("kd", "servo_damping", "damping", "1", 0.0, 0.15, 1.0),
    Kind("ahead", "command_offset", "offset", "rad", 0.0, 0.02),
    Kind("scale", "command_scale", "scale", "1", 0.0, 0.05, 1.0),
    Kind("delay", "command_delay", "delay", "s", 0.0, 0.004),
)
SATURATION = Kind("limit", "torque_saturation", "limit", "N·m", 0.0, 0.0, np.inf)
ORDER = Kind("order", "joint_order", "follows", "1", 0.0, 0.0)
JITTER = Kind("jitter", "command_jitter", "deviation", "s", 0.0, 0.0015)
SLIP = Kind("slip", "foot_slip", "share", "1", 0.0, 0.1)
OF_COMMANDS = frozenset(kind.effect for kind in (*SERVO_KINDS, SATURATION, ORDER, JITTER))
"""Effects that are told by commands beside torques."""


def joint_kinds(robot: Robot) -> dict[str, tuple[float, ...]]:
    """What joints of one kind have in common, left and right, fore and aft: depth, mass of the link, largest torque."""
    tree = read_tree(robot.model)
    kinds: dict[str, tuple[float, ...]] = {}
    for index, name in enumerate(tree.names):
        if name in robot.joint_names:
            depth, parent = 0, index
            while parent > 0:
                depth, parent = depth + 1, int(tree.parents[parent])
            mass = tree.phi[10 * (index - 1)]
            limit = robot.model.effortLimit[tree.idx_v[index]]
            kinds[name] = (depth, float(f"{mass:.2g}"), float(f"{limit:.3g}"))
    return kinds
