"""Rehearsal: before a motion is chosen it is run in simulation, on a robot that carries a load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from excite.campaign.on_disk import OnDisk, read_value
from excite.motion.motion import Motion
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.robot.robot import Robot
from excite.simulation.replay import replay
from excite.simulation.true_parameters import AddedPart, with_part
from excite.simulation.virtual_robot import VirtualRobot, nominal_robot

# What a robot carries that its model does not know, as a share of its mass (Jovic et al. 2016: 5 kg on 58 kg, most of
# it on the trunk), and where: like a knapsack, from the trunk's centre of mass [m, trunk frame at rest: x forwards].
# That shifts the weight backwards, outwards on one leg, and loads the drives of both.
UNKNOWN_LOAD = 0.15
KNAPSACK = (-0.1, 0.0, 0.1)
_LOAD_SIZE_M = 0.1
# How far a point foot may slip while it carries [m]: a quarter of a quadruped's foot.
MAX_SLIP = 0.005


def rehearse(
    robot: Robot, motions: Sequence[Motion], *, jobs: Jobs = 1, progress: Progress = silent
) -> tuple[bool, ...]:
    """Whether a standing robot stays on its feet, does not slip on points, and stays clear of itself in each motion.

    The robot is the model with a load on its back, which is harder than the model itself: a real robot weighs
    more than its model.
    A robot without feet has nothing to fall from: all its motions pass.

    Args:
        robot: the robot.
        motions: what to run, in MuJoCo with contacts and the robot's position servo.
        jobs: number of processes, or an executor; the answer does not depend on it.
        progress: told after each motion.
    """
    if not robot.feet or not robot.floating:
        return (True,) * len(motions)
    # Motions that are on disk are read where they are run.
    tasks: Sequence[Motion | Path] = motions.files if isinstance(motions, OnDisk) else motions
    return tuple(in_order(_stands, tasks, jobs=jobs, shared=robot, stage="rehearse", progress=progress))


def _stands(robot: Robot, task: Motion | Path) -> bool:
    motion = read_value(task) if isinstance(task, Path) else task
    run = replay(loaded_robot(robot), motion)
    # Soles that slip turn and stop; legs on points that slip lose the ground that the motion counts on.
    return run.on_its_feet and (all(foot.flat for foot in robot.feet) or run.max_slip_m <= MAX_SLIP)


def loaded_robot(robot: Robot, offset: tuple[float, float, float] = KNAPSACK) -> VirtualRobot:
    """A virtual robot that carries :data:`UNKNOWN_LOAD` of its mass on its heaviest segment.

    Args:
        robot: the robot, otherwise as its model says.
        offset: of the load's centre from the segment's centre of mass, in the segment's joint frame [m].
    """
    masses = robot.nominal_parameters[::10]
    trunk = int(np.argmax(masses))
    centre = robot.nominal_parameters[10 * trunk + 1 : 10 * trunk + 4] / masses[trunk] + np.array(offset)
    load = AddedPart(
        what="unknown load",
        segment=trunk,
        link=robot.segments[trunk].link,
        mass=UNKNOWN_LOAD * float(masses.sum()),
        position=(float(centre[0]), float(centre[1]), float(centre[2])),
        size=(_LOAD_SIZE_M,) * 3,
    )
    virtual = nominal_robot(robot)
    return replace(virtual, truth=with_part(virtual.truth, load))
