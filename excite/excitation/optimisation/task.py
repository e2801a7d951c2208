"""What an optimised excitation is asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import InputError, UnknownNameError
from excite.excitation.optimisation.limits import JointLimits
from excite.excitation.optimisation.motions import MotionFamily
from excite.excitation.optimisation.objective import CRITERIA, Layout
from excite.motion.generators.generator import free_upper_body, rest_joints
from excite.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class ExcitationTask:
    """A motion to optimise.

    Attributes:
        robot: the robot.
        family: of motions to search in.
        criterion: name in :data:`~excite.excitation.optimisation.objective.CRITERIA`.
        limits: of all joints; the robot's own if None.
        start: ``(n_joints,)`` where the motion starts and ends [rad or m]; None: it is chosen for an arm, and at
            rest for a robot with feet.
        drives: terms of each joint's drive that count as parameters, for an arm.
        independent: columns that stand for the base parameters; the first independent ones if None.
        amplitude_sums: limit the sums of a series' amplitudes (eq. 10 of Xu et al. 2020) and not its peaks.
        avoid_collisions: keep bodies apart, and from the table.
    """

    robot: Robot
    family: MotionFamily
    criterion: str = "condition"
    limits: JointLimits | None = None
    start: Array | None = None
    drives: tuple[str, ...] = ("viscous", "coulomb")
    independent: NDArray[np.int64] | None = None
    amplitude_sums: bool = False
    avoid_collisions: bool = True

    def __post_init__(self) -> None:
        """Check the names and shapes; raises UnknownNameError or InputError."""
        if self.criterion not in CRITERIA:
            raise UnknownNameError("criterion", self.criterion, sorted(CRITERIA))
        if self.start is not None and np.shape(self.start) != (self.robot.n_joints,):
            raise InputError(
                f"start of shape {np.shape(self.start)}", field="start", remedy="give one number a joint"
            )
        if self.robot.floating and not self.robot.feet:
            raise InputError("a floating robot without feet", source=self.robot.name, remedy="name its feet")
        if self.robot.floating and not self.robot.measures_contacts:
            raise InputError(
                "a free base without contact wrench sensors has no optimised series",
                source=self.robot.name,
                remedy="plan with the other generators, or say that its base is held",
            )

    @property
    def joint_limits(self) -> JointLimits:
        """Limits that apply."""
        if self.limits is not None:
            return self.limits
        own = self.robot.limits
        return JointLimits(own.position_lower, own.position_upper, own.velocity, own.acceleration, own.torque)

    def layout(self) -> Layout:
        """Variables of the task; raises NoSolutionError where the limits leave no room."""
        robot, family = self.robot, self.family
        moved = np.flatnonzero(free_upper_body(robot))
        limits = self.joint_limits
        fixed = rest_joints(robot) if robot.feet and self.start is None else self.start
        limits.checked(robot.joint_names, None if fixed is None else np.asarray(fixed)[moved], moved)
        half = 0.5 * (limits.upper - limits.lower)[moved]
        middle = 0.5 * (limits.upper + limits.lower)[moved]
        grid = family.grid(20.0)
        tops = [np.abs(family.basis(grid, order)).max() for order in range(3)]
        rates = np.stack(
            [half / tops[0], limits.velocity[moved] / tops[1], limits.acceleration[moved] / tops[2]]
        )
        return Layout(
            robot=robot,
            family=family,
            joints=moved,
            free_offset=fixed is None,
            start=middle if fixed is None else np.asarray(fixed, dtype=float)[moved],
            reach=half,
            unit=rates.min(axis=0) / np.sqrt(0.5 * family.n_coefficients),
        )
