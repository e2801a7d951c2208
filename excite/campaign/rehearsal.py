"""Rehearsal: before a motion is chosen it is run in simulation, on a robot that carries a load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pinocchio as pin

from excite.campaign.on_disk import OnDisk, read_value
from excite.motion.generators.bodyparts import support_reach
from excite.motion.motion import Motion
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.robot.robot import Robot
from excite.simulation.execution import DivergedError
from excite.simulation.machine import Machine
from excite.simulation.replay import FALL_END_TILT_RAD, watched_run
from excite.simulation.true_parameters import AddedPart, with_part
from excite.simulation.virtual_robot import VirtualRobot, nominal_robot

# What a robot carries that its model does not know, as a share of its mass (Jovic et al. 2016: 5 kg on 58 kg, most of
# it on the trunk), and where: like a knapsack, from the trunk's centre of mass [m, world at rest: x forwards].
# That shifts the weight backwards, outwards on one leg, and loads the drives of both.
UNKNOWN_LOAD = 0.15
# What a robot carries in a second rehearsal where none of its motions stands the first, on small or narrow feet: a
# model that knows its robot that well is the least that a motion without feedback of balance needs.
LEAST_LOAD = 0.05
KNAPSACK = (-0.1, 0.0, 0.1)
_LOAD_SIZE_M = 0.1
# How far a point foot may slip while it carries, in shares of the way from the centre of mass to the support polygon's
# edge at rest: that far the edge may come nearer. It is 5 mm on a Go2, 11 on an ANYmal. Of 98 candidates of seven
# quadrupeds of 9 to 90 kg, 76 slip less, none of which tilts by more than 0.03 rad; where stiff legs pull at each
# other, as a Spot's do, they drag feet by up to 20 %.
MAX_SLIP_SHARE = 0.035
# Steps of the physics [s], the next where it diverges.
_STEPS = (5e-4, 2.5e-4)
# On soles a first run with this step decides where the robot stays far from falling: tilts of motions that stand (of 15
# of G1 and Romeo) are within a tenth of those with 0.25 ms, one of a motion that falls differs by 27 %. With 1 ms alone
# a plan of the G1 keeps 132 motions and not 134, so that what is near the edge is run again with 0.5 ms. Slip is
# another matter: point feet of 15 motions (HyQ, Go2) creep 0.4 mm further with 0.5 ms than with 0.25, and 1 to 4 mm
# further with 1 ms.
_QUICK_STEP = 1e-3
_FAR = 0.5 * FALL_END_TILT_RAD


def rehearse(
    robot: Robot,
    motions: Sequence[Motion],
    *,
    load: float = UNKNOWN_LOAD,
    jobs: Jobs = 1,
    progress: Progress = silent,
) -> tuple[bool, ...]:
    """Whether a standing robot stays on its feet, does not slip on points, and stays clear of itself in each motion.

    The robot is the model with a load on its back, which is harder than the model itself: a real robot weighs
    more than its model.
    A robot without feet has nothing to fall from: all its motions pass.

    Args:
        robot: the robot.
        motions: what to run, in MuJoCo with contacts and the robot's position servo.
        load: on its back, as a share of its mass.
        jobs: number of processes, or an executor; the answer does not depend on it.
        progress: told after each motion.
    """
    if not can_fall(robot):
        return (True,) * len(motions)
    # Motions that are on disk are read where they are run.
    tasks: Sequence[Motion | Path] = motions.files if isinstance(motions, OnDisk) else motions
    shared = (robot, load)
    return tuple(in_order(_stands, tasks, jobs=jobs, shared=shared, stage="rehearse", progress=progress))


def can_fall(robot: Robot) -> bool:
    """Whether a robot stands on feet, so that a rehearsal says anything."""
    return robot.floating and bool(robot.feet)


def may_slip_m(robot: Robot) -> float:
    """How far a point foot of a robot that stands may slip while it carries [m]."""
    return MAX_SLIP_SHARE * support_reach(robot, robot.feet)


def _stands(shared: tuple[Robot, float], task: Motion | Path) -> bool:
    robot, load = shared
    motion = read_value(task) if isinstance(task, Path) else task
    on_soles = all(foot.flat for foot in robot.feet)
    # Soles that slip turn and stop; legs on points that slip lose the ground that the motion counts on.
    may_slip = np.inf if on_soles else may_slip_m(robot)
    for step in (_QUICK_STEP, *_STEPS) if on_soles else _STEPS:
        machine = _machine(robot, load, step, on_soles)
        try:
            run = watched_run(
                machine.virtual, motion, may_slip_m=may_slip, forces=False, machine=machine
            ).replay
        except DivergedError:
            continue
        if step != _QUICK_STEP or (run.on_its_feet and run.max_tilt_rad < _FAR):
            return run.on_its_feet and run.max_slip_m <= may_slip
    return False


@lru_cache(maxsize=4)
def _machine(robot: Robot, load: float, step: float, may_creep: bool) -> Machine:
    """The loaded robot with steps of the physics [s], compiled."""
    loaded = loaded_robot(robot, load=load)
    world = replace(loaded.world, timestep=step, feet_may_creep=may_creep)
    return Machine(replace(loaded, world=world), watch=True)


def loaded_robot(
    robot: Robot, offset: tuple[float, float, float] = KNAPSACK, load: float = UNKNOWN_LOAD
) -> VirtualRobot:
    """A virtual robot that carries a share of its mass on its heaviest segment.

    Args:
        robot: the robot, otherwise as its model says.
        offset: of the load's centre from the segment's centre of mass, in the world's axes at rest [m].
        load: the share.
    """
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.rest)
    masses = robot.nominal_parameters[::10]
    trunk = int(np.argmax(masses))
    # A trunk's frame may lie any way round in it.
    shift = data.oMi[trunk + 1].rotation.T @ np.array(offset)
    centre = robot.nominal_parameters[10 * trunk + 1 : 10 * trunk + 4] / masses[trunk] + shift
    part = AddedPart(
        what="unknown load",
        segment=trunk,
        link=robot.segments[trunk].link,
        mass=load * float(masses.sum()),
        position=(float(centre[0]), float(centre[1]), float(centre[2])),
        size=(_LOAD_SIZE_M,) * 3,
    )
    virtual = nominal_robot(robot)
    return replace(virtual, truth=with_part(virtual.truth, part))
