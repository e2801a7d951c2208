"""An entry by mujoco.sysid: all its parameters fitted at once, the largest change named."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.blind.entry.alone import ArmLog, arm_log
from excite.arrays import Array
from excite.errors import InputError, LogError
from excite.logs.log import Trial
from excite.rows.kinematics import positions_on_grid, trial_grid, trial_rate
from excite.simulation.mjcf import World, build_spec
from excite.simulation.true_parameters import Drives, nominal_drives

# Evaluations of scipy's trust region with sysid's Jacobian. Tried on one UR10 before the torques were those that the
# integrator applies: twelve on 5 s took the cost from 49472 to 119, eight of its own Levenberg-Marquardt on 10 s from
# 94070 to 7134. Eight is what a case can cost, 15 s; whether more would change a name was not tried.
_ITERATIONS = 8


def fitted_by_sysid(folder: Path) -> dict[str, Any]:
    """Answer (``excite.blind_answer/1``) to one case.

    The nominal MuJoCo model under the log's servo follows the log's commands; joints' damping, dry friction, rotor
    inertia and springs, masses and centres of mass of the links, bias of every torque, one delay of them all and,
    where bodies are given, every torque's gain are fitted by ``mujoco.sysid.optimize`` to positions and torques of the
    first trial. The largest change is that of the parameters that are farthest from nominal in units of what their
    covariance (``mujoco.sysid.calculate_intervals``) lets one expect; terms that the log calls modelled, and bodies
    where they are free, are the baseline's and not named. Its share of a joint is what the torque's mean square there
    loses when it is put back to nominal, of the sum of what those that could be named lose so one by one.

    Args:
        folder: of the log.

    Returns:
        The answer; nothing is named where no change leaves its 95 % interval.

    Raises:
        InputError: a library that mujoco.sysid needs is not installed.
        LogError: no log of an arm with torques and commands under a position servo whose gains are stated.
    """
    try:
        # mypy would take the types of this part for those of all of mujoco.
        sysid: Any = import_module("mujoco.sysid")
        optimize = sysid.optimize
    except (ImportError, AttributeError) as error:
        remedy = "pip install 'excite[sysid]'"
        raise InputError("mujoco.sysid lacks libraries", remedy=remedy) from error
    log = arm_log(folder)
    trial = next(trial for trial in log.log.trials if trial.role == "identification")
    fit = TrialFit(log, trial, sysid)
    start = fit.parameters()
    nominal = start.as_nominal_vector()
    # It prints a line an iteration, whatever it is told.
    with redirect_stdout(StringIO()):
        fitted, solution = optimize(
            initial_params=start,
            residual_fn=fit.residual,
            optimizer="scipy_parallel_fd",
            verbose=False,
            max_iters=_ITERATIONS,
            x_scale="jac",
        )
    best = fitted.as_vector()
    full = fit.squares(best, fitted)
    residuals = fit.residual(best, fitted)[0]
    covariance, _ = sysid.calculate_intervals([r.ravel() for r in residuals], solution.jac)
    groups = [group for group in fit.groups if fit.nameable(group)]
    changes, lost = [], []
    for group in groups:
        at = fit.where[group.name]
        change = best[at] - nominal[at]
        changes.append(float(change @ np.linalg.pinv(covariance[at, at]) @ change) / len(change))
        without = best.copy()
        without[at] = nominal[at]
        lost.append(np.maximum((fit.squares(without, fitted) - full)[log.robot.n_joints :], 0.0))
    effects = []
    # What is within its 95 % interval has not changed.
    if groups and max(changes) > 1.96**2:
        k = int(np.argmax(changes))
        taken = np.sum(lost, axis=0)
        for joint, own, total in zip(log.robot.joint_names, lost[k], taken, strict=True):
            effects.append(
                {
                    "effect": groups[k].effect,
                    "location": groups[k].location,
                    "channel": joint,
                    "share": float(own / total) if total > 0.0 else 0.0,
                }
            )
    return {"schema": "excite.blind_answer/1", "program": "mujoco.sysid, largest change", "effects": effects}


# A trial of an arm as mujoco.sysid takes it: the model, its parameters, the residual.

# Steps of the simulator [s]: twice the log's rate, and stable with the stiffest of the bundled arms' servos.
_STEP_S = 2e-3


@dataclass(frozen=True)
class Group:
    """A parameter of mujoco.sysid, its numbers one effect at one place."""

    effect: str
    location: str
    name: str


class TrialFit:
    """The model, its parameters and the residual of one trial."""

    def __init__(self, log: ArmLog, trial: Trial, sysid: Any) -> None:
        import mujoco

        self.log, self.sysid = log, sysid
        robot = log.robot
        drives, at, command = _trial_servo(log, trial)
        self.damping = drives.kd
        phi = np.concatenate(
            [robot.model.inertias[k].toDynamicParameters() for k in range(1, robot.model.njoints)]
        )
        self.spec = build_spec(robot, phi, drives, World(timestep=_STEP_S))
        self.joints = [joint.name for joint in self.spec.joints]
        for name in self.joints:
            for kind in ("JOINTPOS", "JOINTACTFRC"):
                self.spec.add_sensor(
                    name=f"{name}.{kind.lower()}",
                    type=getattr(mujoco.mjtSensor, f"mjSENS_{kind}"),
                    objtype=mujoco.mjtObj.mjOBJ_JOINT,
                    objname=name,
                )
        self.model = self.spec.compile()
        time = trial.time - trial.time[0]
        # Sensors in the model's order: position and torque by turns.
        measured = np.stack([trial.q, log.torque(trial)], axis=2).reshape(len(time), -1)
        v = np.gradient(trial.q[:5], time[:5], axis=0)[0]
        self.sequence = sysid.ModelSequences(
            robot.name,
            self.spec,
            trial.name,
            sysid.create_initial_state(self.model, trial.q[0], v),
            sysid.TimeSeries.from_control_names(at, command, self.model),
            sysid.TimeSeries.from_names(time, measured, self.model),
        )
        self.residual = sysid.build_residual_fn(
            models_sequences=[self.sequence], modify_residual=self._read, n_threads=1
        )
        self.scale = np.maximum(measured.std(axis=0), 1e-9)
        self.groups: list[Group] = []
        self.where: dict[str, slice] = {}
        # Where springs rest.
        self.rest = trial.q.mean(axis=0)
        self.spread = log.torque(trial).std(axis=0)

    def nameable(self, group: Group) -> bool:
        """Whether a change of it is part of the gap and not of the baseline."""
        if group.effect in {"payload", "link_inertia"}:
            return self.log.fixed
        return group.effect not in self.log.modelled

    def parameters(self) -> Any:
        """All parameters at the nominal model's values, or where those are zero a little beside them."""
        made = self.sysid.ParameterDict()

        def add(effect: str, location: str, parameter: Any) -> None:
            at = made.size
            made.add(parameter)
            self.where[parameter.name] = slice(at, made.size)
            self.groups.append(Group(effect, location, parameter.name))

        for j, name in enumerate(self.joints):
            size = float(self.spread[j]) + 1e-3
            for effect, field, low, most in (
                ("viscous_friction", "damping", 0.0, 2.0 * size),
                ("coulomb_friction", "frictionloss", 0.0, size),
                ("armature", "armature", 1e-4, 2.0 * float(self.model.dof_M0.max())),
                ("joint_spring", "stiffness", -5.0 * size, 5.0 * size),
            ):
                nominal = float(np.ravel(getattr(self.model.joint(name), field))[0])
                start = min(max(nominal, low + (0.02 * (most - low) if low >= 0.0 else 0.0)), most)
                modifier = _joint_field(name, field, float(self.rest[j]))
                add(effect, name, self._parameter(f"{name}.{field}", nominal, low, most, modifier, start))
            # Beside bodies that are free a torque's scale is theirs too.
            if self.log.fixed:
                add("torque_gain", name, self._parameter(f"{name}.gain", 1.0, 0.3, 3.0))
            add("torque_bias", name, self._parameter(f"{name}.bias", 0.0, -3.0 * size, 3.0 * size))
        add("time_delay", "torque", self._parameter("delay", 0.0, -0.03, 0.05))
        for segment in self.log.robot.segments:
            body = self.spec.joint(self.log.robot.joint_names[segment.joint - 1]).parent.name
            parameter = self.sysid.body_inertia_param(self.spec, self.model, body, param_name=f"{body}.body")
            add("link_inertia", segment.link, parameter)
        return made

    def squares(self, x: Array, parameters: Any) -> Array:
        """Sum of squares of positions, then torques, by joint, ``(2·n_joints,)``."""
        n = len(self.joints)
        residuals = self.residual(x, parameters)[0][0]
        by_sensor = np.asarray(residuals).reshape(-1, 2 * n)
        total = (by_sensor**2).sum(axis=0)
        return np.concatenate([total[0::2], total[1::2]])

    def _parameter(
        self,
        name: str,
        nominal: float,
        low: float,
        high: float,
        modifier: Any = None,
        start: float | None = None,
    ) -> Any:
        made = self.sysid.Parameter(name, nominal, low, high, modifier=modifier)
        made.value[:] = nominal if start is None else start
        return made

    def _read(
        self,
        params: Any,
        predicted: Any,
        measured: Any,
        model: Any,
        return_pred_all: bool,
        state: Array,
        **_: Any,
    ) -> tuple[Array, Any, Any]:
        """Torques as their channel reads them, and the difference in units of each channel's deviation."""
        sysid = self.sysid
        # The integrator takes the servos' damping at the end of a step, the sensors at its beginning.
        n = len(self.joints)
        change = np.diff(state[:, 1 + n : 1 + 2 * n], axis=0, prepend=state[:1, 1 + n : 1 + 2 * n])
        exact = predicted.data.copy()
        exact[:, 1::2] -= self.damping * change
        predicted = sysid.TimeSeries(predicted.times, exact, predicted.signal_mapping)
        first, last = predicted.times[0] + 0.05, predicted.times[-1] - 0.05
        inside = (measured.times > first) & (measured.times < last)
        at = measured.times[inside]
        data = predicted.resample(at).data.copy()
        late = predicted.resample(at - float(params["delay"].value[0])).data
        for j, name in enumerate(self.joints):
            gain = float(params[f"{name}.gain"].value[0]) if self.log.fixed else 1.0
            bias = float(params[f"{name}.bias"].value[0])
            data[:, 2 * j + 1] = gain * late[:, 2 * j + 1] + bias
        kept = sysid.TimeSeries(at, measured.data[inside], measured.signal_mapping)
        rest = (data - kept.data) / self.scale
        return rest, sysid.TimeSeries(at, data, measured.signal_mapping), kept


def _joint_field(name: str, field: str, rest: float) -> Any:
    """What writes a parameter into a joint of a specification."""

    def write(spec: Any, parameter: Any) -> None:
        joint, value = spec.joint(name), float(parameter.value[0])
        if field in {"damping", "stiffness"}:
            setattr(joint, field, [value, 0.0, 0.0])
        else:
            setattr(joint, field, value)
        if field == "stiffness":
            joint.springref = rest

    return write


class _Servo(NamedTuple):
    """Drives with a log's gains and nothing else; time from the trial's start [s], and what they are told then."""

    drives: Drives
    time: Array
    command: Array


def _trial_servo(log: ArmLog, trial: Trial) -> _Servo:
    """The servo of a trial.

    Commands between rows of the log are on a spline: on straight lines between them stiff servos would
    be told to change their speed in jumps.
    """
    from scipy.interpolate import CubicSpline

    controller, names = log.log.header.controller or {}, log.robot.joint_names
    gains: list[Mapping[str, float]] = [controller.get(what) or {} for what in ("kp", "kd")]
    stated = all(name in gain for gain in gains for name in names)
    if trial.q_cmd is None or controller.get("mode") != "position" or not stated:
        remedy = "this entry needs q_cmd, and kp and kd of a position servo in log.yaml"
        raise LogError("does not say how its joints are driven", source=trial.name, remedy=remedy)
    kp, kd = (np.array([float(gain[name]) for name in names]) for gain in gains)
    zero = np.zeros(len(names))
    drives = replace(nominal_drives(log.robot), kp=kp, kd=kd, viscous=zero, coulomb=zero, armature=zero)
    grid = trial_grid(trial, trial_rate(log.log.header, trial))
    spline = CubicSpline(grid, positions_on_grid(trial.time, trial.q_cmd, grid))
    time = np.arange(0.0, grid[-1] - grid[0], _STEP_S)
    command, speed = spline(grid[0] + time), spline(grid[0] + time, 1)
    follows = controller.get("velocity_reference") != "none"
    return _Servo(drives, time, command + (kd / np.maximum(kp, 1e-12)) * speed * follows)
