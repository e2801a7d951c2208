"""Logs too poor to say what they hold: slow, narrow motions of simulated arms with something hidden in them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.blind.arm_case import Arm, arm_of
from benchmarks.blind.documents import HiddenEffect
from benchmarks.blind.forms import OWN_TERMS, hide_effect
from excite.arrays import Array
from excite.logs.header_blocks import TrialHeader
from excite.logs.log import Log, Trial
from excite.motion.motion import Motion
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.simulation.execution import execute_motion
from excite.simulation.sensing import log_header
from excite.simulation.virtual_robot import VirtualRobot

RATE_HZ, TRIAL_S, PAUSE_S = 200.0, 8.0, 2.0
ROBOTS = ("panda", "ur10", "iiwa14", "jaco2")
NOISE_Q, NOISE_TAU = 2e-5, 0.01


@dataclass(frozen=True)
class Recipe:
    """A log too poor to say which effect it is.

    Attributes:
        effect: what is hidden.
        joint: index of its joint; None for a drawn one.
        fixed: whether the inertial parameters are given.
        lacks: terms that the log does not say are modelled.
        reach: excursions from the posture [rad].
        fastest: largest speed [rad/s].
        harmonics: number of harmonics of the motion.
        base_joint: excursion of the first joint over that of the others.
        size: factor on the usual magnitude.
        noise: factor on the usual noise of the torques.
        others: excursion of the joints beside the effect's over its own.
    """

    effect: str
    joint: int | None = None
    fixed: bool = False
    lacks: tuple[str, ...] = ()
    reach: float = 0.3
    fastest: float = 0.5
    harmonics: int = 2
    base_joint: float = 1.0
    size: float = 1.0
    noise: float = 1.0
    others: float = 1.0


RECIPES = (
    Recipe("joint_spring", joint=0, base_joint=0.3),
    Recipe("joint_spring", joint=0, others=0.5, reach=0.2, size=0.5),
    Recipe("joint_spring", joint=1, fixed=True, reach=0.08, size=0.3, noise=2.0),
    Recipe("joint_spring", joint=2, fixed=True, reach=0.1, size=0.3, others=0.1),
    Recipe("joint_spring", joint=3, fixed=True, reach=0.08, size=0.3, others=0.1),
    Recipe("base_tilt", joint=0, fixed=True, reach=0.1, size=0.1, others=0.3, noise=2.0),
    Recipe("encoder_offset", joint=1, fixed=True, base_joint=0.2, reach=0.15, size=0.2, noise=2.0),
    Recipe("encoder_offset", joint=-2, fixed=True, reach=0.12),
    Recipe("encoder_offset", joint=3, fixed=True, reach=0.08, size=0.3, others=0.1),
    Recipe("torque_bias", joint=1, fixed=True, reach=0.08, size=0.5, noise=2.0),
    Recipe("torque_bias", joint=3, fixed=True, reach=0.1, size=0.5, others=0.1),
    Recipe("torque_gain", joint=1, fixed=True, reach=0.1, size=0.4, others=0.1),
    Recipe("torque_gain", joint=2, fixed=True, reach=0.1, size=0.4, others=0.1),
    Recipe("torque_gain", joint=3, fixed=True, reach=0.1, size=0.4, others=0.1),
    Recipe("backlash", joint=1, fixed=True, reach=0.12, others=0.1),
    Recipe("backlash", joint=2, fixed=True, reach=0.12, others=0.1),
    Recipe("payload", joint=2, fixed=True, reach=0.06, size=0.1, noise=3.0),
    Recipe("link_length_error", joint=2, fixed=True, reach=0.06, size=0.3, noise=3.0),
    Recipe("coulomb_friction", joint=1, lacks=("coulomb_friction",), reach=0.1, others=0.1, noise=2.0),
    Recipe("joint_elasticity", joint=1, reach=0.3, fastest=0.7, size=0.4, noise=5.0),
)


@dataclass(frozen=True, eq=False)
class Case:
    """A robot with something hidden in it, and the session that it has run so far; ``seed`` is of its noise."""

    virtual: VirtualRobot
    answer: HiddenEffect
    modelled: tuple[str, ...]
    sigma: Array
    memory: dict
    trials: list[Trial]
    headers: list[TrialHeader]
    seed: int

    def run(self, motion: Motion, name: str, role: str, repeats: str | None = None) -> None:
        """Run a motion and log it."""
        start = self.headers[-1].start_s + float(self.trials[-1].time[-1]) + PAUSE_S if self.trials else 0.0
        recording = execute_motion(self.virtual, motion.renamed(name), session_s=start, memory=self.memory)
        for reading in self.virtual.readings:
            recording = reading(recording)
        self.headers.append(TrialHeader(file=f"{name}.parquet", role=role, start_s=start, repeats=repeats))
        self.trials.append(
            Trial(
                name=name,
                role=role,
                time=recording.time,
                q=recording.q,
                tau=recording.tau_motor,
                q_cmd=recording.q_cmd,
                start_s=start,
            )
        )

    def sensed(self) -> Log:
        """The log so far; noise as every sensor of this robot has it."""
        made = [
            replace(
                t,
                q=t.q + NOISE_Q * rng.standard_normal(t.q.shape),
                tau=t.tau + self.sigma * rng.standard_normal(t.q.shape),
            )
            for t, rng in ((t, np.random.default_rng((self.seed, k))) for k, t in enumerate(self.trials))
        ]
        header = log_header(self.virtual.robot, tuple(self.headers))
        return Log(
            header.model_copy(update={"modelled": self.modelled}),
            tuple(made),
            robot_text=self.virtual.robot.urdf,
        )


def poor_motion(robot: Robot, recipe: Recipe, name: str, rng: np.random.Generator) -> Motion:
    """A slow, narrow sum of few harmonics about the posture, from rest to rest."""
    time = np.arange(round(TRIAL_S * RATE_HZ) + 1) / RATE_HZ
    s = np.clip(np.minimum(time, TRIAL_S - time) / 1.0, 0.0, 1.0)
    window = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    low, high = robot.limits.position_lower, robot.limits.position_upper
    centre = np.clip(robot.rest, low + 1.5 * recipe.reach, high - 1.5 * recipe.reach)
    q = np.empty((len(time), robot.n_joints))
    for j in range(robot.n_joints):
        pulses = 2.0 * np.pi / TRIAL_S * np.arange(2, 2 + recipe.harmonics)
        wave = window * (
            np.sin(np.outer(time, pulses) + rng.uniform(0.0, 6.28, recipe.harmonics)).sum(axis=1)
        )
        reach = recipe.reach * rng.uniform(0.5, 1.0) * (recipe.base_joint if j == 0 else 1.0)
        reach *= 1.0 if recipe.joint is None or j == recipe.joint % robot.n_joints else recipe.others
        speed = np.abs(np.gradient(wave, time)).max()
        fastest = min(recipe.fastest, 0.8 * robot.limits.velocity[j])
        q[:, j] = centre[j] + wave * min(reach / np.abs(wave).max(), fastest / speed)
    v = np.gradient(q, time, axis=0)
    return Motion(name, robot.name, robot.joint_names, time, q, v, np.gradient(v, time, axis=0))


def build(recipe: Recipe, rng: np.random.Generator) -> Case:
    """Draw the arm and the magnitude, and run the poor session."""
    arm: Arm = arm_of(load_robot(str(rng.choice(ROBOTS))), recipe.fixed, rng)
    robot = arm.virtual.robot
    motions = [poor_motion(robot, recipe, f"trial_{k:02d}", rng) for k in range(4)]
    arm = replace(arm, motions=tuple(motions))
    joint = (
        int(rng.integers(1, robot.n_joints - 1)) if recipe.joint is None else recipe.joint % robot.n_joints
    )
    if "coulomb_friction" in recipe.lacks:
        arm = replace(arm, virtual=without_coulomb(arm.virtual, recipe.effect))
    virtual, answer = hide_effect(arm.virtual, arm, recipe.effect, "plain", joint, recipe.size, rng)
    modelled = ("rigid_body_fixed" if recipe.fixed else "rigid_body", *OWN_TERMS)
    modelled = tuple(word for word in modelled if word not in recipe.lacks)
    case = Case(virtual, answer, modelled, np.zeros(robot.n_joints), {}, [], [], int(rng.integers(1 << 31)))
    for k, motion in enumerate(motions):
        case.run(motion, motion.name, "validation" if k == 3 else "identification")
    case.run(motions[0], "trial_04", "identification", repeats="trial_00.parquet")
    spread = np.vstack([t.tau for t in case.trials]).std(axis=0)
    return replace(case, sigma=recipe.noise * (NOISE_TAU * spread + 2e-4 * spread.max()))


def without_coulomb(virtual: VirtualRobot, effect: str) -> VirtualRobot:
    """The robot without dry friction, unless that is what is to be hidden."""
    if effect == "coulomb_friction":
        return virtual
    return replace(virtual, drives=replace(virtual.drives, coulomb=np.zeros(virtual.robot.n_joints)))
