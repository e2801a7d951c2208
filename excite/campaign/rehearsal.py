"""Rehearsal: before a motion is chosen it is run in simulation, on a robot that carries a load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pinocchio as pin

from excite.campaign.pool import OnDisk, read_value
from excite.motion.generators.generator import support_reach
from excite.motion.motion import Motion
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.results import HIDDEN
from excite.robot.robot import Robot
from excite.safety.repairs.collisions import CollisionProbe
from excite.safety.repairs.draft import Rejection
from excite.safety.verdict import Rehearsed
from excite.simulation.execution import DivergedError, Machine
from excite.simulation.replay import FALL_END_TILT_RAD, WatchedRun, watched_run
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
# Steps of the physics [s], the next where it diverges. Of 420 motions of eight robots (G1, HRP-2, Talos and Go2; R1,
# H1, H1_2 and B2 from their maker's files), 62 of which fall, touch themselves or slip, none has another verdict in
# steps of 2.5 than of 1 ms, in which they take 1.8 times as long.
_STEPS = (2.5e-3, 1e-3, 5e-4, 2.5e-4)
# A robot that tilts further than this, on the way to its end, has come near falling.
_FAR = 0.5 * FALL_END_TILT_RAD

# How far any foot may slip without the load [m].
MOST_SLIP_M = 0.01

FELL, SLIPPED, TOUCHED = "fell_in_rehearsal", "slipped_in_rehearsal", "touched_in_rehearsal"
AT_LIMIT = "drive_at_limit_in_rehearsal"
"""Reasons for which a motion is refused that does not stand its rehearsal."""


def rehearse_motions(
    robot: Robot,
    motions: Sequence[Motion],
    *,
    load: float = UNKNOWN_LOAD,
    jobs: Jobs = 1,
    progress: Progress = silent,
) -> tuple[Rejection | None, ...]:
    """Whether a standing robot stays on its feet, does not slip on points, and stays clear of itself in each motion.

    The robot is the model with a load on its back, which is harder than the model itself: a real robot weighs
    more than its model. What comes near falling on soles, slips on them, or asks of a drive all that it has, has to
    stand without the load as well, where no foot slips by more than 10 mm and no drive is at its limit: there a load
    may hold up what falls without it.
    A robot without feet has nothing to fall from: all its motions pass.

    Args:
        robot: the robot.
        motions: what to run, in MuJoCo with contacts and the robot's position servo.
        load: on its back, as a share of its mass.
        jobs: number of processes, or an executor; the answer does not depend on it.
        progress: told after each motion.

    Returns:
        For each motion what went wrong, with the configuration at that moment; None of one that stands.
    """
    if not can_fall(robot):
        return (None,) * len(motions)
    # Motions that are on disk are read where they are run.
    tasks: Sequence[Motion | Path] = motions.files if isinstance(motions, OnDisk) else motions
    shared = (robot, load)
    return tuple(
        in_order(_rehearse_one, tasks, jobs=jobs, shared=shared, stage="rehearse", progress=progress)
    )


def can_fall(robot: Robot) -> bool:
    """Whether a robot stands on feet, so that a rehearsal says anything."""
    return robot.floating and bool(robot.feet)


def may_slip_m(robot: Robot) -> float:
    """How far a point foot of a robot that stands may slip while it carries [m]."""
    return MAX_SLIP_SHARE * support_reach(robot, robot.feet)


def _rehearse_one(shared: tuple[Robot, float], task: Motion | Path) -> Rejection | None:
    robot, load = shared
    motion = read_value(task) if isinstance(task, Path) else task
    may_slip = _slip_under_load(robot)
    run = _run_rehearsal(robot, load, motion, may_slip)
    refused = _refuse_run(robot, motion, run, may_slip)
    if refused is not None or run is None:
        return refused
    replay = run.replay
    easy = (
        replay.max_tilt_rad < _FAR
        and replay.torque_saturation == 0.0
        and replay.max_slip_m < 0.5 * MOST_SLIP_M
    )
    return None if easy else rehearse_alone(robot, motion).refused


def _slip_under_load(robot: Robot) -> float:
    """Soles that slip turn and stop; legs on points that slip lose the ground that the motion counts on [m]."""
    return np.inf if all(foot.flat for foot in robot.feet) else may_slip_m(robot)


@dataclass(frozen=True)
class Rehearsal(Rehearsed):
    """What a motion did in simulation on a robot as its model says, without any load.

    Attributes:
        refused: why the motion is not safe, None if it is.
    """

    refused: Rejection | None = field(default=None, metadata=HIDDEN)


def rehearse_alone(robot: Robot, motion: Motion) -> Rehearsal:
    """Run a motion of a standing robot without a load, until something goes wrong."""
    may_slip = min(MOST_SLIP_M, _slip_under_load(robot))
    run = _run_rehearsal(robot, 0.0, motion, may_slip)
    refused = _refuse_run(robot, motion, run, may_slip)
    if run is None:
        return Rehearsal(False, 0.0, False, 0.0, refused)
    replay, recording = run.replay, run.recording
    shares = np.where(recording.clipped, 1.0, np.abs(recording.tau_motor) / robot.limits.torque)
    if refused is None and (shares >= 1.0).any():
        row, joint = (int(k) for k in np.argwhere(shares >= 1.0)[0])
        limit = float(robot.limits.torque[joint])
        name, time = robot.joint_names[joint], float(recording.time[row])
        refused = Rejection(motion.name, AT_LIMIT, name, time, float(shares[row, joint]) * limit, limit)
    most = float(shares.max(initial=0.0))
    return Rehearsal(not replay.fell, replay.max_slip_m, replay.self_collided, most, refused)


def _refuse_run(robot: Robot, motion: Motion, run: WatchedRun | None, may_slip: float) -> Rejection | None:
    """What went wrong in a run, first of all a fall; a run that diverges counts as one."""
    if run is None:
        return Rejection(motion.name, FELL, "base")
    replay, recording = run.replay, run.recording
    if replay.fell:
        return Rejection(motion.name, FELL, _explain_fall(robot, run), replay.fell_at_s)
    if replay.self_collided:
        row = int(np.argmax(recording.touches > 0))
        near = CollisionProbe(robot).closest(recording.q[row : row + 1])
        # What is apart from all else has met the ground.
        where = near.pair if near.distance < near.required else "ground"
        posture = tuple(float(x) for x in recording.q[row])
        return Rejection(motion.name, TOUCHED, where, float(recording.time[row]), posture=posture)
    if replay.max_slip_m > may_slip:
        foot = max(replay.slip_m, key=lambda name: max(replay.slip_m[name], default=0.0))
        return Rejection(motion.name, SLIPPED, foot, value=replay.max_slip_m, limit=may_slip)
    return None


def _explain_fall(robot: Robot, run: WatchedRun) -> str:
    """Where a fall began: the drive that was longest at its torque limit by then, if any was."""
    longest = int(np.argmax(run.recording.clipped.sum(axis=0)))
    if not run.recording.clipped[:, longest].any():
        return "base"
    return f"base, {robot.joint_names[longest]} at its torque limit"


def _run_rehearsal(robot: Robot, load: float, motion: Motion, may_slip: float) -> WatchedRun | None:
    """A run in the longest steps of the physics in which it does not diverge; None if it does in all."""
    for step in _STEPS:
        machine = _loaded_machine(robot, load, step)
        try:
            return watched_run(machine.virtual, motion, may_slip_m=may_slip, forces=False, machine=machine)
        except DivergedError:
            continue
    return None


@lru_cache(maxsize=4)
def _loaded_machine(robot: Robot, load: float, step: float) -> Machine:
    """The robot with a load and steps of the physics [s], compiled."""
    loaded = loaded_robot(robot, load=load) if load else nominal_robot(robot)
    return Machine(replace(loaded, world=replace(loaded.world, timestep=step)), watch=True)


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
