"""What motions promise before anything is measured: precision of the parameters, and how much motion a target takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from excite.arrays import Array
from excite.excitation.precision import determined_columns, excitable_parameters, nominal_values, row_noise
from excite.finding import list_names
from excite.formats.number import check_number
from excite.identification.judgement import ParameterOutlook, said_rsd
from excite.identification.noise import EquationNoise, equation_noise, trial_grids
from excite.identification.parameter_statistics import essential_parameters
from excite.identification.problem import IdentificationProblem, build_problem
from excite.identification.regression import RANK_TOLERANCE, condense_problem, least_squares
from excite.identification.statistics import BaseEstimate, parameter_labels, relative_percent
from excite.logs.header_blocks import TrialHeader
from excite.logs.log import Log, Trial
from excite.motion.motion import Motion, closed_contacts, interpolate_motion
from excite.regressor.base_parameters import base_parameters, r_factor, structural_base_parameters
from excite.regressor.columns import DRIVE_TERMS
from excite.robot.robot import Robot
from excite.rows.settings import ProblemSettings
from excite.simulation.sensing import imu_readings, log_header
from excite.simulation.true_parameters import nominal_drives
from excite.threads import one_blas_thread

# How precisely motions will determine the parameters, predicted from the noise of the robot's sensors.


@dataclass(frozen=True, eq=False)
class PredictedStatistics(BaseEstimate):
    """Least squares on the base parameters before the experiment; the model's values stand for the truth.

    Attributes:
        labels: names of all columns, ``(n_params,)``.
        whole: ``(k, n_params)`` triangular factor of all weighted columns.
    """

    labels: tuple[str, ...]
    whole: Array

    @property
    def rsd_percent(self) -> Array:
        """Relative standard deviations of all base parameters, ``(n_base,)``."""
        return relative_percent(self.std, self.estimate)

    def essential_rsd(self) -> dict[str, float]:
        """Predicted RSD of each essential parameter, by the name of its own column [percent].

        With all base parameters estimated together, as in an identification's ``base_parameters``: which of the
        small ones elimination will take out, and with them others' deviations, is up to the draw of the noise.
        """
        rsd = self.rsd_percent
        return {self.base.labels[i]: float(rsd[i]) for i in essential_parameters(self).kept}


@one_blas_thread
def predict_statistics(robot: Robot, motions: Sequence[Motion]) -> PredictedStatistics:
    """What identification would say of its own precision, had the robot run these motions.

    The rows are those of :func:`~excite.identification.problem.build_problem` for a log without noise: same
    filters, same samples left out at the ends and at standstill, same drive terms. The noise of each sensor
    reaches them as :mod:`excite.identification.noise` says, and weights are one over what it leaves
    in each channel. Friction that changes its sign at once, which smoothed columns follow only so far, is an
    error of the model that adds to an arm's noise.

    Args:
        robot: the robot; noise and rate of its sensors are those of ``robot.yaml``.
        motions: all that will be run for identification.

    Raises:
        InputError: an arm whose description does not state the noise of its torques.
        LogError: the motions leave no rows.
    """
    return _compute_statistics(*_planned_equations(robot, motions))


# Motions that the noise of all is predicted from: the sensors' own decides it.
_NOISE_MOTIONS = 3


@one_blas_thread
def filtered_noise(robot: Robot, motions: Sequence[Motion]) -> Array:
    """Standard deviation of the noise in each of a sample's rows once identification has filtered the log.

    Filters take most of a sensor's noise, and the base's pose adds its own.

    Args:
        robot: the robot; noise and rate of its sensors are those of ``robot.yaml``.
        motions: as they will be run; the first of them are looked at.

    Returns:
        As of :func:`~excite.excitation.precision.row_noise`, which it is where identification takes other rows.

    Raises:
        InputError: an arm whose description does not state the noise of its torques.
        LogError: the motions leave no rows.
    """
    stated = row_noise(robot)
    found = _planned_equations(robot, list(motions[:_NOISE_MOTIONS]))[1].channel_std()
    return found if found.shape == stated.shape else stated


def _planned_equations(
    robot: Robot, motions: Sequence[Motion]
) -> tuple[IdentificationProblem, EquationNoise]:
    settings = ProblemSettings()
    problem = build_problem(robot, _planned_log(robot, motions, settings), settings)
    grids = trial_grids(problem)
    named = {motion.name: motion for motion in motions}
    return problem, equation_noise(robot, problem, grids, named, robot.description.sensors.rate_hz)


def _compute_statistics(problem: IdentificationProblem, noise: EquationNoise) -> PredictedStatistics:
    rows = condense_problem(problem).weighted(noise.channel_std())
    misfit = np.sqrt(rows.residual_variances(least_squares(rows.factor)))
    if misfit.any():
        noise = noise.with_misfit(misfit)
    std = noise.channel_std()
    rows = rows.weighted(std)
    n = problem.n_params
    labels, whole = parameter_labels(problem), rows.factor[:, :n]
    base = base_parameters(whole, labels, RANK_TOLERANCE)
    factor = r_factor(whole[:, base.independent])[: base.rank]
    weighted = problem.Y[:, base.independent] / std[problem.channel, None]
    q = solve_triangular(factor, weighted.T, trans="T", check_finite=False).T / std[problem.channel, None]
    values = base.values(problem.prior)
    return PredictedStatistics(base, values, factor, noise.meat(q), factor @ values, labels, whole)


def _planned_log(robot: Robot, motions: Sequence[Motion], settings: ProblemSettings) -> Log:
    """The log that the motions would leave, without noise, of forces only what the model may fail to explain."""
    own = robot.description.sensors.rate_hz
    filters = settings.filters(floating=robot.measures_contacts)
    # The planned log is sampled so many times as densely as the filter of the kinematics passes. With four, deviations
    # of essential parameters are within 1.7 % of those with twenty (HyQ 0.7 %, UR5 0.05 %, Romeo 1.7 %, where they are
    # below 100 %; one of Romeo's is essential with twenty and not with four); with eight they take twice as long.
    step = max(1, int(own / (4.0 * min(filters.kinematics_cutoff_hz, own))))
    rate = own / step
    headers = tuple(TrialHeader(file=f"{motion.name}.parquet", role="identification") for motion in motions)
    header = log_header(robot, headers).model_copy(update={"rate_hz": rate})
    return Log(header=header, trials=tuple(_planned_trial(robot, motion, rate) for motion in motions))


def _planned_trial(robot: Robot, motion: Motion, rate_hz: float) -> Trial:
    n = int(motion.duration * rate_hz + 1e-9) + 1
    sampled = interpolate_motion(motion, robot, motion.time[0] + np.arange(n) / rate_hz)
    # As a log has them: what follows from the motors is not recorded.
    motors = ~robot.passive
    friction = nominal_drives(robot).coulomb * np.sign(sampled.v[:, robot.n_base_v :])
    return Trial(
        name=motion.name,
        role="identification",
        time=sampled.time,
        q=sampled.joint_positions()[:, motors],
        tau=None if robot.description.sensors.joint_torque is None else friction[:, motors],
        base=sampled.q[:, :7] if robot.floating else None,
        imu=None
        if robot.description.sensors.imu is None or not robot.floating
        else imu_readings(robot, sampled),
        wrenches={sensor.name: np.zeros((n, 6)) for sensor in robot.sensors},
        contacts=dict(zip((f.name for f in robot.feet), closed_contacts(robot, sampled).T, strict=True)),
    )


# How many parameters will be certain enough after the motions at hand, and how much more motion the others
# take.

# What is asked for unless somebody asks for something else: a value is known to a seventh of itself [percent].
TARGET_RSD = 15.0


def check_target(target_rsd: float) -> None:
    """Refuse what is no relative standard deviation to ask for; raises InputError."""
    # Below a millionth of a per cent rounding decides; a thousandfold deviation is no target [percent].
    check_number(target_rsd, "target_rsd", 1e-6, 1e5, "percent")


# What motions promise for each base parameter: whether it can be excited, is excited, and how precisely.


@dataclass(frozen=True)
class Outlook:
    """What is to be expected of an experiment.

    Attributes:
        parameters: one a structural base parameter.
    """

    parameters: tuple[ParameterOutlook, ...]

    @property
    def essential_rsd(self) -> dict[str, float]:
        """Predicted RSD of the parameters expected to be essential, by name [percent]."""
        return {p.name: p.rsd_percent for p in self.parameters if p.essential and p.rsd_percent is not None}

    def summary(self) -> str:
        """Two lines for a person."""
        found = self.essential_rsd
        lines = []
        if found:
            middle = float(np.median(list(found.values())))
            worst = max(found, key=lambda name: found[name])
            lines.append(
                f"predicted RSD of {len(found)} essential parameters: median {said_rsd(middle)}, "
                f"largest {said_rsd(found[worst])} ({worst})"
            )
        never = [p.name for p in self.parameters if not p.excitable]
        missed = [p.name for p in self.parameters if p.excitable and not p.excited]
        if not never and not missed:
            rotors = any(p.name.startswith("armature(") for p in self.parameters)
            among = " (rotor inertias among them)" if rotors else ""
            lines.append(f"all {len(self.parameters)} base parameters{among} can be excited, and are")
        if never:
            lines.append("no motion with these contacts excites: " + list_names(never, 6))
        if missed:
            lines.append(
                "not excited by the chosen motions, though some motion could: " + list_names(missed, 6)
            )
        return "\n".join(lines)


def is_predictable(robot: Robot) -> bool:
    """Whether ``robot.yaml`` says enough of the sensors: joint torques, or wrenches, with their noise."""
    sensors = robot.description.sensors
    if robot.measures_contacts:
        return all(s.noise_force > 0.0 and s.noise_moment > 0.0 for s in robot.sensors)
    noise = sensors.noise_torque
    stated = noise is not None and (noise.default is not None or set(robot.driven_names) <= set(noise.joints))
    return sensors.joint_torque is not None and stated


@one_blas_thread
def outlook(robot: Robot, motions: Sequence[Motion]) -> Outlook:
    """Judge motions before anything is measured.

    Args:
        robot: the robot, which has to be :func:`is_predictable`.
        motions: all that will be run for identification.

    Raises:
        InputError: the noise of the robot's sensors is not stated.
        LogError: the motions leave no rows.
    """
    predicted = predict_statistics(robot, motions)
    drives = tuple(term for term in DRIVE_TERMS if f"{term}({robot.joint_names[0]})" in predicted.labels)
    base = structural_base_parameters(robot, drives)
    own = [predicted.labels.index(label) for label in base.labels]
    # As of unexcited_parameters in excite.excitation.conditioning: feet stay on the ground to a solver's tolerance.
    excited = determined_columns(predicted.whole[:, own], 1e-6)
    able = excitable_parameters(robot, base)
    values = nominal_values(robot, base)
    found = dict(zip(predicted.base.labels, predicted.rsd_percent, strict=True))
    kept = predicted.essential_rsd().keys()
    parameters = []
    for i, name in enumerate(base.labels):
        rsd = float(found.get(name, np.inf))
        parameters.append(
            ParameterOutlook(
                name=name,
                expression=base.expressions[i],
                excitable=bool(able[i]),
                excited=bool(excited[i]),
                value=float(values[i]),
                rsd_percent=rsd if excited[i] and np.isfinite(rsd) else None,
                essential=name in kept,
            )
        )
    return Outlook(tuple(parameters))
