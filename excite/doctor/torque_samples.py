"""Torques of a log beside those of the nominal model, joint by joint."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import LogError
from excite.logs.log import Log
from excite.logs.robot import robot_in_log
from excite.logs.signals.butterworth import lowpass
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Robot
from excite.rows.drive_terms import smooth_sign
from excite.rows.joint_rows import JointRows
from excite.rows.kinematics import forces_on_grid, trial_kinematics
from excite.rows.settings import ProblemSettings

_SAMPLES = 1500
# Nominal masses are believed within these factors.
_GAIN = (0.5, 2.0)
# Less than this share of a torque's power is no better explained.
FLOOR = 1e-3
# A torque whose power is all but this share in its mean is a dead channel.
_DEAD = 1e-12


@dataclass(frozen=True, eq=False)
class TorqueSamples:
    """Samples of a log's identification trials.

    Attributes:
        robot: the robot.
        places: joints' indices into ``v``.
        q: ``(n, nq)`` filtered.
        v: ``(n, nv)``.
        a: ``(n, nv)``.
        torque: ``(n, n_joints)`` filtered as the positions [N·m].
        width: velocity over which Coulomb friction changes sign [rad/s].
    """

    robot: Robot
    places: NDArray[np.int64]
    q: Array
    v: Array
    a: Array
    torque: Array
    width: float

    def arranged(
        self, positions: NDArray[np.int64], signs: Array, torques: NDArray[np.int64]
    ) -> TorqueSamples:
        """Joints' motions and torques taken from other columns, motions with other signs."""
        shift = self.q.shape[1] - self.v.shape[1]
        q, v, a = self.q.copy(), self.v.copy(), self.a.copy()
        for values, offset in ((q, shift), (v, 0), (a, 0)):
            values[:, self.places + offset] = values[:, self.places[positions] + offset] * signs
        return replace(self, q=q, v=v, a=a, torque=self.torque[:, torques])

    def predicted(self) -> Array:
        """Rigid bodies' nominal torques, ``(n, n_joints)``."""
        return inverse_dynamics(self.robot.model, self.q, self.v, self.a)[:, self.places]

    def drive_columns(self, joint: int) -> Array:
        """Constant, viscous, Coulomb and inertia column of a joint, ``(n, 4)``."""
        v, a = self.v[:, self.places[joint]], self.a[:, self.places[joint]]
        return np.column_stack([np.ones_like(v), v, smooth_sign(v, self.width), a])


def torque_samples(robot: Robot, log: Log, settings: ProblemSettings) -> TorqueSamples | None:
    """Samples at which some joint moves, thinned out; None where no trial can be used."""
    robot = robot_in_log(robot, log.header, log.folder)
    filters = settings.filters(floating=False)
    filters = replace(filters, kinematics_cutoff_hz=filters.cutoff_hz)
    places = np.array([robot.n_base_v + robot.joint_index(name) for name in log.header.torque_joints])
    source = JointRows(robot, log.header, settings, filters, ())
    parts = []
    for trial in log.role("identification"):
        try:
            k = trial_kinematics(robot, log.header, trial, settings, filters)
            torque = forces_on_grid(trial.time, source.torque(trial), k.time)
        except LogError:
            continue
        torque = lowpass(torque, k.rate_hz, filters.cutoff_hz, filters.order)
        use = k.valid.copy()
        use[: k.moving.start] = use[k.moving.stop :] = False
        parts.append([values[use] for values in (k.q, k.v, k.a, torque)])
    if not parts or not sum(len(part[0]) for part in parts):
        return None
    q, v, a, torque = (np.concatenate([part[i] for part in parts]) for i in range(4))
    step = max(1, len(q) // _SAMPLES)
    width = max(settings.coulomb_width, 0.02)
    return TorqueSamples(robot, places, q[::step], v[::step], a[::step], torque[::step], width)


def share_left(samples: TorqueSamples, torque: Array, model: Array, joint: int) -> float:
    """Share of a torque's power that the model and the joint's drive leave.

    Args:
        samples: where the drive's columns come from.
        torque: measured, ``(n,)`` [N·m].
        model: nominal, ``(n,)`` [N·m]; its gain is free within a factor of two.
        joint: index of the joint whose drive may help.
    """
    drive = samples.drive_columns(joint)
    drive = drive / np.maximum(np.linalg.norm(drive, axis=0), 1e-300)
    basis, _ = np.linalg.qr(drive)
    y = torque - basis @ (basis.T @ torque)
    x = model - basis @ (basis.T @ model)
    gain = float(np.clip(x @ y / max(float(x @ x), 1e-300), *_GAIN))
    power = float(((torque - torque.mean()) ** 2).sum())
    # A torque that never changes, filters' rounding aside, is explained by nothing.
    if power <= _DEAD * float(torque @ torque):
        return 1.0
    return float(((y - gain * x) ** 2).sum()) / max(power, 1e-300)


def mean_left(samples: TorqueSamples) -> float:
    """Mean over the joints of half the logarithm of what is left, lower is better."""
    return 0.5 * float(np.mean(np.log(np.maximum(shares_left(samples), FLOOR))))


def shares_left(samples: TorqueSamples) -> Array:
    """:func:`share_left` of each joint's own torque and model, ``(n_joints,)``."""
    model, torque = samples.predicted(), samples.torque
    return np.array([share_left(samples, torque[:, j], model[:, j], j) for j in range(torque.shape[1])])


def modelled_gains(samples: TorqueSamples) -> tuple[Array, Array]:
    """Measured torque per modelled torque, and its share of the torque's power, each ``(n_joints,)``."""
    model = samples.predicted()
    gains, shares = [], []
    for j in range(model.shape[1]):
        drive = samples.drive_columns(j)
        basis, _ = np.linalg.qr(drive / np.maximum(np.linalg.norm(drive, axis=0), 1e-300))
        torque = samples.torque[:, j]
        y, x = torque - basis @ (basis.T @ torque), model[:, j] - basis @ (basis.T @ model[:, j])
        gain = float(x @ y) / max(float(x @ x), 1e-300)
        power = float(((torque - torque.mean()) ** 2).sum())
        gains.append(gain)
        shares.append(gain**2 * float(x @ x) / max(power, 1e-300))
    return np.array(gains), np.array(shares)


def own_inertia(samples: TorqueSamples) -> Array:
    """Mean inertia that each joint has by the nominal model, ``(n_joints,)``: torque per acceleration."""
    model, (n, nv) = samples.robot.model, samples.v.shape
    some = slice(None, None, max(1, n // 20))
    q, rest = samples.q[some], np.zeros((len(samples.q[some]), nv))
    still, found = inverse_dynamics(model, q, rest, rest), []
    for place in samples.places:
        push = rest.copy()
        push[:, place] = 1.0
        found.append(float(np.mean((inverse_dynamics(model, q, rest, push) - still)[:, place])))
    return np.array(found)


def scaled_fit(columns: Array, values: Array) -> Array:
    """Least-squares weights of columns of very different size, ``(k,)``."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    return np.linalg.lstsq(columns / scale, values, rcond=1e-10)[0] / scale
