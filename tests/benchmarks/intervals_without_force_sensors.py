"""Coverage of 95 % intervals where contact forces are taken out of the rows: a toy quadruped, white noise on torques.

``python -m tests.benchmarks --only intervals_without_force_sensors``; ``EXCITE_DRAWS`` changes the number of draws.
"""

from __future__ import annotations

import os
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.identification.problem import IdentificationProblem, build_problem
from excite.identification.regression import condense_problem, iterate_weights
from excite.identification.statistics import base_statistics
from excite.logs.header_blocks import TrialHeader
from excite.logs.log import Log, Trial
from excite.motion.generators.registry import make_generator
from excite.motion.motion import Motion
from excite.regressor.contact_forces import contact_elimination
from excite.robot.joint_values import per_joint
from excite.robot.robot import Robot
from excite.rows.joint_rows import JointRows, closed_on_grid, drive_terms
from excite.rows.kinematics import filtered_rows, trial_kinematics
from excite.rows.settings import ProblemSettings
from excite.safety.filter import filter_candidate
from excite.simulation.sensing import log_header
from tests.benchmarks.table import Row
from tests.quadruped import quadruped

DRAWS = int(os.environ.get("EXCITE_DRAWS", "100"))
_MOTIONS = (("sway", 3), ("foot_swing", 4))
LOW, HIGH = 0.93, 0.97


def rows() -> list[Row]:
    """Coverage over all base parameters and draws."""
    with tempfile.TemporaryDirectory() as folder:
        robot = quadruped(Path(folder))
        inside = covered(robot, motions(robot), DRAWS)
    single = 100.0 * inside.mean(axis=0)
    return [
        Row.holds(
            f"95 % intervals without force sensors, {len(single)} base parameters, {DRAWS} draws: truth inside",
            "93–97 %",
            f"{100.0 * inside.mean():.1f} % (single parameters {single.min():.0f}–{single.max():.0f})",
            LOW <= inside.mean() <= HIGH,
        )
    ]


def motions(robot: Robot) -> list[Motion]:
    """Safe sways and swings."""
    found = []
    for generator, count in _MOTIONS:
        for candidate in make_generator(generator).candidates(robot, count, np.random.SeedSequence(5)):
            motion = filter_candidate(robot, candidate).motion
            if motion is None:
                raise RuntimeError(f"{candidate.name} was refused")
            found.append(motion)
    return found


def covered(robot: Robot, performed: list[Motion], draws: int) -> Array:
    """Whether each interval holds its base parameter, ``(draws, n_base)``."""
    log = _log(robot, performed)
    blank = build_problem(robot, log)
    exact = blank.Y @ blank.prior
    noise = _noise_rows(robot, log, blank, draws)
    held = []
    for draw in range(draws):
        problem = replace(blank, y=exact + noise[:, draw])
        found = base_statistics(iterate_weights(condense_problem(problem)))
        held.append(np.abs(found.estimate - found.base.values(blank.prior)) < found.half_width())
    return np.array(held)


def _log(robot: Robot, performed: list[Motion]) -> Log:
    """The motions as if a robot had followed them exactly, torques left out."""
    headers = tuple(TrialHeader(file=f"{m.name}.parquet", role="identification") for m in performed)
    header = log_header(robot, headers).model_copy(update={"imu": None})
    trials = tuple(
        Trial(
            m.name,
            "identification",
            m.time,
            m.q[:, 7:],
            np.zeros((len(m.time), robot.n_joints)),
            base=m.q[:, :7],
            contacts=dict(m.contacts),
        )
        for m in performed
    )
    return Log(header.model_copy(update={"rate_hz": _rate(performed[0])}), trials, robot_text=robot.urdf)


def _rate(motion: Motion) -> float:
    return 1.0 / float(np.median(np.diff(motion.time)))


def _noise_rows(robot: Robot, log: Log, blank: IdentificationProblem, draws: int) -> Array:
    """What white noise on the torques leaves in the rows, ``(n_rows, draws)``: through elimination and filter."""
    settings = ProblemSettings()
    filters = settings.filters(floating=False, lowpass_hz=None)
    builder = JointRows(robot, log.header, settings, filters, drive_terms(log.header, settings))
    sigma = per_joint(robot.description.sensors.noise_torque, robot.joint_names, np.zeros(robot.n_joints))
    rng, parts = np.random.default_rng(11), []
    for index, trial in enumerate(log.trials):
        k = trial_kinematics(robot, log.header, trial, settings, filters)
        drawn = sigma[:, None] * rng.standard_normal((len(k.time), robot.n_joints, draws))
        out = eliminated(builder, trial, k.q, k.time)
        passed = filtered_rows(
            lambda part, out=out, drawn=drawn: out[part] @ drawn[part],
            k,
            filters,
            np.ones((len(k.time), robot.n_joints), dtype=bool),
        )
        rows = np.flatnonzero(blank.trial == index)
        at = np.searchsorted(passed.time, blank.time[rows] - 1e-9)
        parts.append(passed.values[at, blank.channel[rows]])
    return np.concatenate(parts)


def eliminated(builder: JointRows, trial: Trial, q: Array, time: Array) -> Array:
    """What takes joint torques to rows without contact forces, ``(n, n_joints, n_joints)``."""

    return contact_elimination(builder.robot, q, closed_on_grid(builder.robot, trial, time))[:, :, 6:]
