"""The verb ``simulate``: an experiment on a virtual robot whose truth differs from the model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from excite.display import Shown, count
from excite.documents.document import read_document
from excite.documents.plan import PlanDocument
from excite.errors import MotionError, NoSolutionError
from excite.formats.number import check_seed
from excite.logs.files import save_log
from excite.logs.header_blocks import Role
from excite.logs.log import Log, Trial
from excite.motion.collection import MotionsLike, as_motions
from excite.motion.motion import Motion
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.results import FilePath, Name, Stated, UnboundedPositive, write_json
from excite.robot.load import RobotLike, as_robot
from excite.robot.robot import Robot
from excite.safety.checks.motion import refuse_time_faults
from excite.simulation.effects.registry import inject_effects as inject_effects
from excite.simulation.replay import Replay
from excite.simulation.simulate import run_experiment
from excite.simulation.true_parameters import TrueParameters
from excite.simulation.virtual_robot import Injected, VirtualRobot, changed_robot, nominal_robot


@dataclass(frozen=True)
class Added(Stated):
    """A body that the model does not have.

    Attributes:
        what: what it is.
        link: link that carries it.
        mass: [kg].
    """

    what: Name
    link: Name
    mass: float


@dataclass(frozen=True)
class Truth(Stated):
    """True inertial parameters of a virtual robot, for comparison afterwards.

    Attributes:
        robot: name of the robot.
        masses: true mass by link [kg].
        added: bodies that were added.
        parameters: ten inertial parameters a link, about its joint's frame [SI].
        injected: effects that were injected, which the log's ``modelled`` does not name.
    """

    SCHEMA = "excite.truth/1"

    robot: Name
    masses: Mapping[Name, float]
    added: tuple[Added, ...] = ()
    parameters: tuple[float, ...] = ()
    injected: tuple[Injected, ...] = ()


@dataclass(frozen=True)
class SimulatedTrial(Stated):
    """What became of one motion.

    Attributes:
        trial: name of the motion.
        samples: number of logged samples.
        fell: whether the robot fell.
        self_collided: whether it touched itself.
        slip_m: largest slip of a foot [m].
        tracking_error_rad: largest error of tracking [rad or m].
    """

    trial: Name
    samples: int
    fell: bool
    self_collided: bool
    slip_m: UnboundedPositive
    tracking_error_rad: UnboundedPositive

    @classmethod
    def of(cls, trial: Trial, replay: Replay) -> SimulatedTrial:
        """Of the recording, and of what was watched."""
        error = replay.max_tracking_error_rad
        return cls(trial.name, len(trial.time), replay.fell, replay.self_collided, replay.max_slip_m, error)


@dataclass(frozen=True)
class Simulation(Stated):
    """What became of motions on the virtual robot.

    Attributes:
        robot: name of the robot.
        log: description of the log, relative to ``--out``.
        trials: in the order of the motions.
        fell: whether the robot fell in any motion.
        other_version: motions that were made for this robot with another description or model.
    """

    SCHEMA = "excite.simulation/1"

    robot: Name
    log: FilePath
    trials: tuple[SimulatedTrial, ...]
    fell: bool
    other_version: tuple[Name, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Experiment(Shown):
    """A log of a virtual robot, and the truth that a real one would keep to itself.

    Attributes:
        robot: the nominal robot.
        log: what its sensors said.
        truth: its true inertial parameters.
        replays: what became of each motion: falls, slips, touches, tracking.
        other_version: names of the motions that were made for this robot with another description or model.
        injected: effects that were injected.
    """

    robot: Robot
    log: Log
    truth: TrueParameters
    replays: tuple[Replay, ...]
    other_version: tuple[str, ...] = ()
    injected: tuple[Injected, ...] = ()

    @property
    def fallen(self) -> tuple[str, ...]:
        """Names of the motions during which it fell."""
        return tuple(replay.motion for replay in self.replays if replay.fell)

    @property
    def fell(self) -> bool:
        """Whether it fell in any motion."""
        return bool(self.fallen)

    def truth_json(self) -> dict[str, Any]:
        """True masses and what was added, for comparison afterwards; no part of the log."""
        links = (segment.link for segment in self.robot.segments)
        return Truth(
            robot=self.robot.name,
            masses=dict(zip(links, self.truth.phi[::10].tolist(), strict=True)),
            added=tuple(Added(part.what, part.link, part.mass) for part in self.truth.parts),
            parameters=tuple(self.truth.phi.tolist()),
            injected=self.injected,
        ).to_json()

    def to_json(self) -> dict[str, Any]:
        """The ``excite.simulation/1`` document."""
        pairs = zip(self.log.trials, self.replays, strict=True)
        return Simulation(
            self.robot.name,
            "log.yaml",
            tuple(SimulatedTrial.of(trial, replay) for trial, replay in pairs),
            self.fell,
            self.other_version,
        ).to_json()

    def summary(self) -> str:
        """A few lines for a person."""
        seconds = sum(float(trial.time[-1] - trial.time[0]) for trial in self.log.trials)
        end = f"fell in {', '.join(self.fallen)}" if self.fell else "stayed on its feet"
        if not self.robot.floating:
            end = "done"
        said = f"{self.robot.name}: {count(len(self.log.trials), 'motion')}, {seconds:.0f} s, {end}"
        if self.other_version:
            names = ", ".join(self.other_version)
            said += f"\nmade for another version of this robot, and not known to be safe for it: {names}"
        return said

    def without_falls(self) -> Experiment:
        """The same experiment without the trials in which the robot fell.

        Raises:
            NoSolutionError: it fell in every one.
        """
        kept = [i for i, replay in enumerate(self.replays) if not replay.fell]
        if not kept:
            raise NoSolutionError(
                "the virtual robot fell in every motion", best=self, remedy="check the motions"
            )
        header = self.log.header.model_copy(update={"trials": tuple(self.log.header.trials[i] for i in kept)})
        log = replace(self.log, header=header, trials=tuple(self.log.trials[i] for i in kept))
        return replace(self, log=log, replays=tuple(self.replays[i] for i in kept))

    def save(self, folder: Path) -> Path:
        """Write the log folder and, beside the log, ``truth.json``."""
        save_log(self.log, folder)
        write_json(self.truth_json(), Path(folder) / "truth.json")
        return Path(folder)


def virtual_robot(
    robot: Robot, seed: int, *, nominal: bool = False, inject: Sequence[str] = ()
) -> VirtualRobot:
    """The virtual robot of a seed.

    Args:
        robot: the nominal robot.
        seed: decides where it differs from its model.
        nominal: give it the model's own inertial parameters and drives.
        inject: effects as ``EFFECT[:LOCATION[:VALUE]]``.

    Raises:
        InputError: an effect is malformed; UnknownNameError: an effect or its place is unknown.
    """
    check_seed(seed)
    # A stream of random numbers of its own, so that noise does not shift it.
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
    return inject_effects(nominal_robot(robot) if nominal else changed_robot(robot, rng), inject)


def simulate(
    robot: RobotLike,
    motions: MotionsLike,
    *,
    inject: str | Sequence[str] = (),
    nominal: bool = False,
    roles: Mapping[str, Role] | None = None,
    seed: int = 0,
    batch: int = 0,
    jobs: Jobs = 1,
    progress: Progress = silent,
) -> Experiment:
    """Run motions on a virtual robot and log them.

    Args:
        robot: the nominal robot, or what :func:`~excite.robot.load.load_robot` takes.
        motions: what to run, motions, files or folders; every fifth, in order, is logged as validation unless
            ``roles`` says otherwise.
        inject: effects as ``EFFECT[:LOCATION[:VALUE]]``, or one; the log's ``modelled`` names none of them, the truth
            all.
        nominal: give the virtual robot the model's own parameters.
        roles: by motion name, ``identification`` or ``validation``.
        seed: decides the virtual robot, and with ``batch`` the sensors' noise.
        batch: number of the experiment on the same robot.
        jobs: number of processes, or an executor; the log does not depend on it.
        progress: told after each motion.

    Returns:
        The log of the virtual robot, and what is true of it.

    Raises:
        InputError: no motions, an effect is malformed; UnknownNameError: an effect or its place is unknown.
        MotionError: a motion is not for this robot, or its samples are none that a controller could run.
    """
    robot = as_robot(robot)
    motions = as_motions(motions, robot)
    for motion in motions:
        _check_runs(robot, motion)
    effects = [inject] if isinstance(inject, str) else inject
    virtual = virtual_robot(robot, seed, nominal=nominal, inject=effects)
    noise = np.random.SeedSequence(seed, spawn_key=(2, batch))
    if roles is None:
        roles = {motion.name: "validation" for motion in motions[4::5]}
    runs = run_experiment(virtual, motions, seed=noise, roles=roles, jobs=jobs, progress=progress)
    others = tuple(m.name for m in motions if m.metadata.robot_hash not in ("", robot.hash))
    log = _without_injected(runs.log, virtual.injected)
    return Experiment(robot, log, virtual.truth, runs.replays, others, virtual.injected)


def _check_runs(robot: Robot, motion: Motion) -> None:
    """Refuse a motion of another robot, and one that time makes none of; raises MotionError."""
    if motion.robot != robot.name:
        raise MotionError(
            f"is a motion of {motion.robot!r}, not of {robot.name!r}",
            source=motion.name,
            field="robot",
            remedy="name the robot that it was made for",
        )
    refuse_time_faults(motion)


def _without_injected(log: Log, injected: Sequence[Injected]) -> Log:
    """The log whose baseline lacks what was injected: what it names, no diagnosis would look for."""
    names = {one.effect for one in injected}
    modelled = tuple(name for name in log.header.modelled if name not in names)
    return replace(log, header=log.header.model_copy(update={"modelled": modelled}))


# What planned motions are for: to identify from, or to validate on, as the plan beside them says.


def planned_roles(paths: Iterable[Path]) -> dict[str, Role]:
    """Roles of motions by their names, from the ``plan.json`` in or above their folders; empty where there is none."""
    found: dict[str, Role] = {}
    for folder in dict.fromkeys(
        f for path in paths for f in (Path(path), *Path(path).absolute().parents[:2])
    ):
        file = folder / "plan.json"
        if not file.is_file():
            continue
        plan = read_document(file, PlanDocument)
        found |= {Path(item.motion).stem: "identification" for item in plan.selected}
        found |= {Path(item).stem: "validation" for item in plan.validation}
    return found
