"""One case of an arm: its motions simulated with what is hidden in it, and logged as sensors and loggers do."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.blind.arm_case import FAULTS, N_TRIALS, N_VALIDATION, PAUSE_S, TRIAL_S, Arm, Servo, arm_of
from benchmarks.blind.detectability import effect_detectability
from benchmarks.blind.documents import Answer, HiddenEffect
from benchmarks.blind.draw import Draft
from benchmarks.blind.forms import OWN_TERMS, hide_background, hide_effect, left_out, without_term
from benchmarks.blind.laws import BristleLaw
from excite.arrays import Array
from excite.logs.header_blocks import Role, TrialHeader
from excite.logs.log import Log, Trial
from excite.robot.loading import load_robot
from excite.simulation.effects.laws import AsymmetryLaw, WarmingLaw
from excite.simulation.execution import execute_motion
from excite.simulation.sensing import log_header
from excite.simulation.virtual_robot import Recording, VirtualRobot

_NOISE_Q = 2e-5


_NOISE_TAU = 0.01


def build_case(plan: Draft, rng: np.random.Generator, servo: Servo | None = None) -> tuple[Log, Answer]:
    """Simulate one case.

    Args:
        plan: what it is to have.
        rng: source of everything else.
        servo: of the arm, where it is another than the robot's own.

    Returns:
        Its log and what is hidden in it.
    """
    arm = arm_of(load_robot(plan.robot), plan.fixed, rng)
    if servo is not None:
        arm = servo.on(arm)
    start = deepcopy(rng)
    made = _prepare_robot(arm, plan, rng)
    virtual, modelled = made.virtual, made.modelled
    recordings = recordings_of(virtual, arm)
    sigma = noise_of(recordings, plan.noise)
    trials, headers = log_session(recordings, arm, plan.noise, plan.faults, sigma, rng)
    header = log_header(virtual.robot, headers).model_copy(update={"modelled": modelled})
    log = Log(header=header, trials=trials, robot_text=virtual.robot.urdf)
    known = []
    for k, item in enumerate(made.hidden):
        twin = _prepare_robot(arm, plan, deepcopy(start), without=k).virtual
        clear = effect_detectability(arm.virtual.robot, recordings, recordings_of(twin, arm), modelled, sigma)
        known.append(replace(item, detectability=clear))
    return log, Answer(plan.kind, plan.robot, modelled, tuple(known), plan.noise, plan.faults, made.others)


@dataclass(frozen=True, eq=False)
class _Prepared:
    """A robot before its experiment.

    Attributes:
        virtual: with everything in it.
        hidden: the effects to be found.
        modelled: what the log says that the baseline has.
        others: faint effects in the background.
    """

    virtual: VirtualRobot
    hidden: tuple[HiddenEffect, ...]
    modelled: tuple[str, ...]
    others: tuple[HiddenEffect, ...]


def _prepare_robot(arm: Arm, plan: Draft, rng: np.random.Generator, without: int | None = None) -> _Prepared:
    """The robot of a case, and what is in it.

    ``without``: position of a hidden effect that is drawn but left out.
    """
    virtual, n = arm.virtual, arm.virtual.robot.n_joints
    hidden: list[HiddenEffect] = []
    modelled = ["rigid_body_fixed" if plan.fixed else "rigid_body", *OWN_TERMS]
    joints = rng.permutation(np.arange(1, n - 1) if plan.fixed else np.arange(n))
    size = 0.6 if plan.kind == "weak" else 1.0
    for k, ((effect, form), drawn) in enumerate(zip(plan.effects, joints, strict=False)):
        if effect in modelled:
            modelled.remove(effect)
        joint = _fitting_joint(arm, effect, int(drawn))
        changed, what = hide_effect(virtual, arm, effect, form, joint, size, rng)
        virtual = changed if k != without else left_out(virtual, changed, effect, joint)
        hidden.append(what)
    others: tuple[HiddenEffect, ...] = ()
    if plan.kind == "weak":
        virtual, others = hide_background(virtual, arm, rng)
    if plan.absent in modelled:
        modelled.remove(plan.absent)
        virtual = replace(virtual, drives=without_term(virtual.drives, plan.absent))
    if plan.bristles and "coulomb_friction" in modelled:
        # Bristles take the place of dry friction; a law that takes some of it away would find none.
        taken = {law.joint for law in virtual.laws if isinstance(law, BristleLaw | AsymmetryLaw | WarmingLaw)}
        for j in set(range(n)) - taken:
            virtual = virtual.with_law(BristleLaw(j, float(virtual.drives.coulomb[j]), breakaway=1.5e-3))
    return _Prepared(virtual, tuple(hidden), tuple(modelled), others)


def _fitting_joint(arm: Arm, effect: str, joint: int) -> int:
    """A joint at which the effect can show: load-dependent friction needs a load, a payload an end."""
    n = len(arm.load)
    if effect == "load_dependent_friction" and arm.load[joint] < 0.1 * arm.load.max():
        return int(np.argmax(arm.load))
    return n - 1 if effect == "payload" and joint % 2 else joint


def recordings_of(virtual: VirtualRobot, arm: Arm) -> list[Recording]:
    """Identification trials, validation trials, then the first command again, without noise."""
    runs = [*arm.motions, replace(arm.motions[0], name=f"trial_{N_TRIALS + N_VALIDATION:02d}")]
    memory: dict[Any, Any] = {}
    recordings: list[Recording] = []
    for k, motion in enumerate(runs):
        recording = execute_motion(virtual, motion, session_s=k * (TRIAL_S + PAUSE_S), memory=memory)
        for reading in virtual.readings:
            recording = reading(recording)
        recordings.append(recording)
    return recordings


def noise_of(recordings: list[Recording], noise: float) -> Array:
    """Standard deviation of each torque channel's white noise, ``noise`` times the usual, ``(n_joints,)`` [N·m]."""
    spread = np.vstack([r.tau_motor for r in recordings]).std(axis=0)
    return np.asarray(noise * (_NOISE_TAU * spread + 2e-4 * spread.max()))


def log_session(
    recordings: list[Recording],
    arm: Arm,
    noise: float,
    faults: tuple[str, ...],
    sigma: Array,
    rng: np.random.Generator,
) -> tuple[tuple[Trial, ...], tuple[TrialHeader, ...]]:
    """The trials as sensors and logger give them.

    Args:
        recordings: of the arm's motions and the repeat, without noise.
        arm: whose motions they are.
        noise: factor on the usual noise of positions.
        faults: kinds of faults of the record.
        sigma: ``(n_joints,)`` standard deviation of the torques' white noise [N·m].
        rng: source of noise and faults.

    Returns:
        The trials and what the log's header says of them.
    """
    trials, headers = [], []
    for k, recording in enumerate(recordings):
        role: Role = "validation" if N_TRIALS <= k < N_TRIALS + N_VALIDATION else "identification"
        repeats = f"{arm.motions[0].name}.parquet" if k == len(recordings) - 1 else None
        file = f"{recording.name}.parquet"
        headers.append(TrialHeader(file=file, role=role, start_s=k * (TRIAL_S + PAUSE_S), repeats=repeats))
        shape = recording.q.shape
        trial = Trial(
            name=recording.name,
            role=role,
            time=recording.time,
            q=recording.q + noise * _NOISE_Q * rng.standard_normal(shape),
            tau=recording.tau_motor + sigma * rng.standard_normal(shape),
            q_cmd=recording.q_cmd,
            start_s=headers[-1].start_s,
        )
        for fault in faults:
            trial = FAULTS[fault](trial, rng)
        trials.append(trial)
    return tuple(trials), tuple(headers)
