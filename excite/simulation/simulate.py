"""Run motions on a virtual robot and log them as the real one would."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from excite.errors import InputError
from excite.logs.header_blocks import Role, TrialHeader
from excite.logs.log import Log, Trial
from excite.motion.motion import Motion
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.robot.loading import portable_description
from excite.simulation.replay import Replay, watched_run
from excite.simulation.sensing import log_header, sense_recording
from excite.simulation.virtual_robot import VirtualRobot

# Pause between two trials of a session [s]: the robot returns and settles.
_PAUSE_S = 5.0


@dataclass(frozen=True, eq=False)
class SimulatedRuns:
    """What a virtual robot logged and what became of it.

    Attributes:
        log: one trial a motion; the trial of a motion in which the robot fell ends with the fall.
        replays: one a trial.
    """

    log: Log
    replays: tuple[Replay, ...]


def run_experiment(
    virtual: VirtualRobot,
    motions: Sequence[Motion],
    *,
    seed: int | np.random.SeedSequence,
    roles: Mapping[str, Role] | None = None,
    jobs: Jobs = 1,
    progress: Progress = silent,
) -> SimulatedRuns:
    """Run each motion under the robot's position servo and log what its sensors say.

    The noise of each trial comes from its own child of ``seed``, so that neither the number of processes nor
    the other motions change a trial.

    Args:
        virtual: the robot.
        motions: what to run, names all different.
        seed: of the sensors' noise.
        roles: by motion name, ``identification`` (the default) or ``validation``.
        jobs: number of processes, or an executor; the log does not depend on it.
        progress: told after each motion.

    Returns:
        The log, complete for :func:`excite.logs.files.save_log`, and a judgement of each run.

    Raises:
        InputError: no motions, two of one name, or a role for a motion that is not there.
        MotionError: a motion is not for this robot, or the simulation diverged.
        UnphysicalParametersError: the true parameters belong to no body.
    """
    names = [motion.name for motion in motions]
    roles = dict(roles or {})
    if not names:
        raise InputError("no motions to simulate", remedy="name at least one")
    for i, name in enumerate(names):
        if name in names[:i]:
            raise InputError(f"two motions are called {name!r}", remedy="rename one")
    for name in roles:
        if name not in names:
            raise InputError(
                f"a role is given to {name!r}, which is not run", remedy="motions are " + ", ".join(names)
            )
    starts = np.concatenate([[0.0], np.cumsum([motion.duration + _PAUSE_S for motion in motions])])
    root = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    # The children that ``root.spawn`` would give, without changing ``root``.
    seeds = (
        np.random.SeedSequence(root.entropy, spawn_key=(*root.spawn_key, index), pool_size=root.pool_size)
        for index in range(len(names))
    )
    tasks = (
        _Run(motion, roles.get(motion.name, "identification"), seed, float(start))
        for motion, seed, start in zip(motions, seeds, starts, strict=False)
    )
    found = in_order(
        _simulate_trial,
        tasks,
        jobs=jobs,
        shared=virtual,
        total=len(names),
        stage="simulate",
        progress=progress,
    )
    done = list(found)
    trials = tuple(trial for trial, _ in done)
    headers = tuple(
        TrialHeader(
            file=f"{trial.name}.parquet",
            role=roles.get(trial.name, "identification"),
            session=trial.session,
            start_s=trial.start_s,
        )
        for trial in trials
    )
    robot = virtual.robot
    # The nominal model that a log brings along: a URDF, which says nothing of loops, or the whole description.
    text = robot.urdf if robot.mechanism is None else portable_description(robot)
    log = Log(header=log_header(robot, headers), trials=trials, robot_text=text)
    return SimulatedRuns(log, tuple(judgement for _, judgement in done))


@dataclass(frozen=True, eq=False)
class _Run:
    """One motion to be run: its trial's role, seed of noise, and when in the session it starts [s]."""

    motion: Motion
    role: Role
    seed: np.random.SeedSequence
    session_s: float


def _simulate_trial(virtual: VirtualRobot, task: _Run) -> tuple[Trial, Replay]:
    run = watched_run(virtual, task.motion, task.session_s)
    trial = sense_recording(virtual, run.recording, task.role, np.random.default_rng(task.seed))
    return replace(trial, session="simulation", start_s=task.session_s), run.replay
