"""Rehearsal: a motion of a robot that stands is run in simulation before it is chosen, checked or exported."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from hashlib import blake2b
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pinocchio as pin

from excite.arrays import Array, Moved
from excite.cache import cached_file, read_cached, write_cached
from excite.motion.content import content_hash, motion_columns
from excite.motion.generators.generator import support_corners, support_reach
from excite.motion.motion import Motion
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.results import HIDDEN
from excite.robot.prismatic import sliding_joints
from excite.robot.robot import Robot
from excite.robot.shapes.shape import joints_at
from excite.safety.ground_forces import hull_edges
from excite.safety.parameter_set import RowsOfSet, stated_parameters
from excite.safety.repairs.collisions import CollisionProbe
from excite.safety.repairs.draft import Rejection
from excite.safety.verdict import Rehearsed, Verdict, Violation, unit_of
from excite.simulation.execution import DivergedError, Machine
from excite.simulation.replay import FALL_END_TILT_RAD, WatchedRun, watched_run
from excite.simulation.true_parameters import AddedPart, TrueParameters, possible_parameters, with_part
from excite.simulation.virtual_robot import VirtualRobot, nominal_robot

# What a robot carries that its model does not know, as a share of its mass (Jovic et al. 2016: 5 kg on 58 kg, most of
# it on the trunk), and where: like a knapsack, from the trunk's centre of mass [m, world at rest: x forwards].
# That shifts the weight backwards, outwards on one leg, and loads the drives of both.
UNKNOWN_LOAD = 0.15
# What a robot carries in a second rehearsal where none of its motions stands the first, on small or narrow feet: a
# model that knows its robot that well is the least that a motion without feedback of balance needs.
LEAST_LOAD = 0.05
# Steps of the physics [s], the next where it diverges. Of 420 motions of eight robots (G1, HRP-2, Talos and Go2; R1,
# H1, H1_2 and B2 from their maker's files), 62 of which fall, touch themselves or slip, none has another verdict in
# steps of 2.5 than of 1 ms, in which they take 1.8 times as long.
_STEPS = (2.5e-3, 1e-3, 5e-4, 2.5e-4)
# A robot that tilts further than this, on the way to its end, has come near falling.
_FAR = 0.5 * FALL_END_TILT_RAD

# How far any foot may slip without the load [m].
MOST_SLIP_M = 0.01

MODEL = "model"
"""The robot as its model says."""

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
    shared, which = (robot, load, motions), range(len(motions))
    return tuple(
        in_order(_rehearse_one, which, jobs=jobs, shared=shared, stage="rehearse", progress=progress)
    )


def can_fall(robot: Robot) -> bool:
    """Whether a robot stands on feet, so that a rehearsal says anything."""
    return robot.floating and bool(robot.feet)


def may_slip_m(robot: Robot) -> float:
    """How far a point foot of a robot that stands may slip while it carries [m]."""
    # How far a point foot may slip while it carries, in shares of the way from the centre of mass to the support
    # polygon's edge at rest: that far the edge may come nearer. It is 5 mm on a Go2, 11 on an ANYmal. Of 98 candidates
    # of seven quadrupeds of 9 to 90 kg, 76 slip less, none of which tilts by more than 0.03 rad; where stiff legs pull
    # at each other, as a Spot's do, they drag feet by up to 20 %.
    return 0.035 * support_reach(robot, robot.feet)


def _rehearse_one(shared: tuple[Robot, float, Sequence[Motion]], index: int) -> Rejection | None:
    robot, load, motions = shared
    motion = motions[index]
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


def rehearse_alone(robot: Robot, motion: Motion, *, uncertain: bool = False) -> Rehearsal:
    """Run a motion of a standing robot without a load, until something goes wrong.

    Args:
        robot: the robot.
        motion: from rest to rest.
        uncertain: whether the two members of :func:`leaning_members` run it after the model.

    Returns:
        The worst over these robots. It is kept on disk (:mod:`excite.cache`) under the motion's samples, the robot, and
        the code and simulator that ran it: what was rehearsed before is read.
    """
    members = leaning_members(robot) if uncertain else {}
    motion_key = content_hash(motion_columns(motion)).encode()
    # A set may change with a file that the description only names.
    set_key = b"".join(phi.tobytes() for phi in members.values())
    file = cached_file("rehearsals", _rehearsal_key(robot), set_key, motion_key)
    kept = read_cached(file)
    if kept is not None:
        return _parse_rehearsal(kept, motion.name)
    found: list[Rehearsal] = []
    for which in (MODEL, *members):
        found.append(_rehearse_member(robot, motion, which))
        if found[-1].refused is not None:
            break
    rehearsal = Rehearsal(
        tuple(one.robots[0] for one in found),
        all(one.stands for one in found),
        max(one.slip_m for one in found),
        any(one.touches for one in found),
        max(one.drive_share for one in found),
        found[-1].refused,
    )
    write_cached(file, json.dumps(asdict(rehearsal)).encode())
    return rehearsal


def rehearsed_verdict(robot: Robot, motion: Motion, verdict: Verdict, *, robust: bool = False) -> Verdict:
    """The verdict on a motion with what it does in simulation, where the robot stands and nothing is violated.

    Args:
        robot: the robot.
        motion: the motion.
        verdict: of the independent check on it.
        robust: whether the set of robots has to keep it even where its description states none.
    """
    # A motion of a chain starts or ends on the way, which no rehearsal of it alone does.
    if not verdict.safe or not can_fall(robot) or motion.metadata.previous or motion.metadata.following:
        return verdict
    rehearsal = rehearse_alone(robot, motion, uncertain=robust or robot.description.uncertainty is not None)
    refused = rehearsal.refused
    if refused is None:
        return replace(verdict, rehearsal=rehearsal)
    unit = unit_of(refused.reason, refused.where, sliding_joints(robot))
    found = Violation(refused.reason, refused.time_s, refused.where, refused.value, refused.limit, unit)
    return replace(verdict, violations=(found,), rehearsal=rehearsal)


@lru_cache(maxsize=4)
def leaning_members(robot: Robot) -> dict[str, Array]:
    """Of the robot's stated set of parameters the members that lean furthest, by name, ``(10·n_segments,)`` each.

    At rest the moment of the weight about an edge of the support polygon is linear in the parameters: one member makes
    the most of it about the edge that is nearest to the centre of mass, another one the least.
    """
    parameters = stated_parameters(robot)
    rest = Moved(robot.rest[None], *np.zeros((2, 1, robot.model.nv)))
    corners = support_corners(robot, robot.feet)
    edges = hull_edges(corners[None])[0]
    edges = edges[np.isfinite(edges[:, 0])]
    if not len(edges):
        return {}
    centre = np.array(pin.centerOfMass(robot.model, robot.model.createData(), robot.rest))[:2]
    x, y, offset = edges[np.argmin(edges[:, :2] @ centre - edges[:, 2])]
    over = (
        np.array([0.0, 0.0, offset, -y, x, 0.0]) @ RowsOfSet(robot, parameters).of_wrench(rest).of_wrench[0]
    )
    return {
        "leaning to the nearest edge": robot.nominal_parameters + parameters.farthest(over),
        "leaning away from it": robot.nominal_parameters + parameters.farthest(-over),
    }


def _rehearse_member(robot: Robot, motion: Motion, which: str) -> Rehearsal:
    may_slip = min(MOST_SLIP_M, _slip_under_load(robot))
    run = _run_rehearsal(robot, 0.0, motion, may_slip, which)
    refused = _refuse_run(robot, motion, run, may_slip)
    if run is None:
        return Rehearsal((which,), False, 0.0, False, 0.0, refused)
    replay, recording = run.replay, run.recording
    limits = robot.limits.while_between("torque", recording.q[:, robot.n_base_q :])
    limits = np.broadcast_to(limits, recording.tau_motor.shape)
    shares = np.where(recording.clipped, 1.0, np.abs(recording.tau_motor) / limits)
    if refused is None and (shares >= 1.0).any():
        row, joint = (int(k) for k in np.argwhere(shares >= 1.0)[0])
        limit = float(limits[row, joint])
        name, time = robot.joint_names[joint], float(recording.time[row])
        refused = Rejection(motion.name, AT_LIMIT, name, time, float(shares[row, joint]) * limit, limit)
    most = float(shares.max(initial=0.0))
    return Rehearsal((which,), not replay.fell, replay.max_slip_m, replay.self_collided, most, refused)


def _parse_rehearsal(content: bytes, motion: str) -> Rehearsal:
    found = json.loads(content)
    refused = found.pop("refused")
    if refused is not None:
        refused = Rejection(**{**refused, "candidate": motion})
    return Rehearsal(**{**found, "robots": tuple(found["robots"]), "refused": refused})


@lru_cache(maxsize=4)
def _rehearsal_key(robot: Robot) -> bytes:
    """What decides a rehearsal beside the motion: the robot, as it may have been changed in memory, code, simulator."""
    digest = blake2b(robot.hash.encode())
    limits = {**vars(robot.limits)}
    digest.update(repr(limits.pop("tables")).encode())
    for values in (robot.nominal_parameters, robot.rest, *limits.values()):
        digest.update(np.ascontiguousarray(values, dtype=float).tobytes())
    digest.update(repr([(foot.name, foot.friction, foot.sole.tolist()) for foot in robot.feet]).encode())
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    return digest.digest() + version("mujoco").encode()


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
        return Rejection(motion.name, TOUCHED, where, float(recording.time[row]))
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


def _run_rehearsal(
    robot: Robot, load: float, motion: Motion, may_slip: float, which: str = MODEL
) -> WatchedRun | None:
    """A run in the longest steps of the physics in which it does not diverge; None if it does in all."""
    for step in _STEPS:
        machine = _loaded_machine(robot, load, step, which)
        try:
            return watched_run(machine.virtual, motion, may_slip_m=may_slip, forces=False, machine=machine)
        except DivergedError:
            continue
    return None


@lru_cache(maxsize=4)
def _loaded_machine(robot: Robot, load: float, step: float, which: str) -> Machine:
    """The robot with a load, or a member of its set, and steps of the physics [s], compiled."""
    loaded = loaded_robot(robot, load=load) if load else nominal_robot(robot)
    if which != MODEL:
        bodies = zip(leaning_members(robot)[which].reshape(-1, 10), robot.segments, strict=True)
        phi = np.concatenate([possible_parameters(own, segment.link) for own, segment in bodies])
        loaded = replace(loaded, truth=TrueParameters(phi))
    return Machine(replace(loaded, world=replace(loaded.world, timestep=step)), watch=True)


def loaded_robot(
    robot: Robot, offset: tuple[float, float, float] = (-0.1, 0.0, 0.1), load: float = UNKNOWN_LOAD
) -> VirtualRobot:
    """A virtual robot that carries a share of its mass on its heaviest segment.

    Args:
        robot: the robot, otherwise as its model says.
        offset: of the load's centre from the segment's centre of mass, in the world's axes at rest [m].
        load: the share.
    """
    data = joints_at(robot.model, robot.rest)
    masses = robot.nominal_parameters[::10]
    trunk = int(np.argmax(masses))
    # A trunk's frame may lie any way round in it.
    shift = data.oMi[trunk + 1].rotation.T @ np.array(offset)
    centre = robot.nominal_parameters[10 * trunk + 1 : 10 * trunk + 4] / masses[trunk] + shift
    part = AddedPart.on_segment(robot, "unknown load", trunk, load * float(masses.sum()), centre, (0.1,) * 3)
    virtual = nominal_robot(robot)
    return replace(virtual, truth=with_part(virtual.truth, part))
