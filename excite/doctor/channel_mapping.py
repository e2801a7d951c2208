"""How the channels of a log are read: column, sign, unit, zero and clock of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from excite.arrays import Array, Indices
from excite.logs.log import Log, Trial
from excite.regressor.kernels import inverse_dynamics
from excite.regressor.tree import KinematicTree

# Ways in which a logged base pose may be meant.


class BasePose(Enum):
    """What the seven columns of a base pose hold; the log's own way first."""

    STATED = "position, quaternion x y z w, of the base in the world"
    SCALAR_FIRST = "quaternion w x y z"
    INVERSE = "orientation of the world in the base"
    MILLIMETRES = "positions in millimetres"

    def read(self, pose: Array) -> Array:
        """Poses as the log's format has them, ``(n, 7)``, from columns that are meant this way."""
        order = [0, 1, 2, 4, 5, 6, 3] if self is BasePose.SCALAR_FIRST else list(range(7))
        places = 1e-3 if self is BasePose.MILLIMETRES else 1.0
        turned = -1.0 if self is BasePose.INVERSE else 1.0
        return np.asarray(pose[:, order] * [*[places] * 3, *[turned] * 3, 1.0])


# How a log's channels are read: which column is whose, with which sign, unit, zero and clock.

# Where torques are late, rows that have none are left out of trials of which so much has its own. Two seconds of
# torques that follow nothing looked 0.72 s early where half was enough: bodies explain by chance more of fewer rows.
OWN_SHARE = 0.75


@dataclass(frozen=True, eq=False)
class Reading:
    """What is to be done to a log's channels before they are what the log says that they are.

    Attributes:
        position_of: ``(n_joints,)`` column that holds each joint's position.
        position_sign: ``(n_joints,)`` ±1.
        unit: ``(n_joints,)`` of positions in radians or metres: π/180 where they are degrees.
        joined: ``(n_joints, n_joints)`` what makes joints' positions of these, as where motors of a differential turn
            by the sum and the difference of two joints; its inverse makes their torques of those of the motors.
        zero: ``(n_joints,)`` added to positions, after all that [rad or m].
        torque_of: ``(n_torques,)`` column that holds the torque of each joint that has one.
        torque_factor: ``(n_torques,)`` torques are multiplied by it, sign and all.
        tick: seconds per unit of the stamps.
        late_s: how much later than positions torques, currents and wrenches were logged [s].
        gravity: ``(3,)`` in the world frame [m/s²].
        sensor_of: ``(n_sensors,)`` whose columns hold each contact sensor's wrench.
        wrench_map: ``(n_sensors, 6, 6)`` what makes a wrench of these columns: signs, axes, units.
        wrench_added: ``(n_sensors, 6)`` constants that are added to them then [N, N·m].
        pose: what the columns of the base pose hold.
        taken: ``(n_torques, 3)`` gravity under which a driver took the nominal weight off each torque before it
            reported it, zero where it took none [m/s²].
        absent: ``(10·n_segments,)`` inertial parameters of a body that is not there and whose weight a driver took
            off all torques [SI]; empty for none.
    """

    position_of: Indices
    position_sign: Array
    unit: Array
    joined: Array
    zero: Array
    torque_of: Indices
    torque_factor: Array
    tick: float
    late_s: float
    gravity: Array
    sensor_of: Indices
    wrench_map: Array
    wrench_added: Array
    taken: Array
    absent: Array
    pose: BasePose = BasePose.STATED

    @classmethod
    def as_stated(cls, log: Log) -> Reading:
        """Every channel is what the log says."""
        n, m = len(log.header.joints), len(log.header.torque_joints)
        return cls(
            position_of=np.arange(n),
            position_sign=np.ones(n),
            unit=np.ones(n),
            joined=np.eye(n),
            zero=np.zeros(n),
            torque_of=np.arange(m),
            torque_factor=np.ones(m),
            tick=1.0,
            late_s=0.0,
            gravity=np.array(log.header.gravity),
            sensor_of=np.arange(len(log.header.sensors)),
            wrench_map=np.tile(np.eye(6), (len(log.header.sensors), 1, 1)),
            wrench_added=np.zeros((len(log.header.sensors), 6)),
            taken=np.zeros((m, 3)),
            absent=np.zeros(0),
        )

    @property
    def weightless(self) -> bool:
        """Whether nothing of the nominal weight is in any torque."""
        return bool(self.taken.any() and (self.taken == self.gravity).all() and not self.absent.any())

    @property
    def is_compensated(self) -> bool:
        """Whether some of the weight, of bodies that are there or not, was taken off some torque."""
        return bool(self.taken.any() or self.absent.any())

    def taken_weight(self, tree: KinematicTree, q: Array, columns: Indices) -> Array:
        """What a driver took off torques by the nominal model of ``tree``, ``(n, n_torques)`` [N·m or N].

        Args:
            tree: the nominal robot.
            q: ``(n, nq)`` configurations.
            columns: where in ``v`` the joints with a torque are.
        """
        still, weight = np.zeros((len(q), tree.nv)), np.zeros((len(q), len(columns)))
        for pull in {tuple(row) for row in self.taken.tolist() if any(row)}:
            own = inverse_dynamics(replace(tree, gravity=np.array(pull)), q, still, still)[:, columns]
            weight += own * (self.taken == pull).all(axis=1)
        if self.absent.any():
            absent = replace(tree, gravity=np.asarray(self.gravity), phi=self.absent)
            weight += inverse_dynamics(absent, q, still, still)[:, columns]
        return weight

    def motion_key(self) -> bytes:
        """Equal for readings that make the same motion of the same log."""
        rest = [self.tick, list(BasePose).index(self.pose)]
        taken = (self.taken, self.absent)
        channels = (self.position_of, self.position_sign, self.unit, self.joined, self.zero)
        parts = (*channels, rest, self.gravity, *taken)
        return b"".join(np.asarray(part, dtype=float).tobytes() for part in parts)

    def with_weight(self) -> Reading:
        """Torques of which no driver has taken anything off."""
        return replace(self, taken=np.zeros_like(self.taken), absent=np.zeros(0))

    def with_position(self, joint: int, sign: float = 1.0, zero: float = 0.0) -> Reading:
        """One joint's position turned, or moved by a constant."""
        signs, zeros = self.position_sign.copy(), self.zero.copy()
        signs[joint] *= sign
        zeros[joint] = sign * zeros[joint] + zero
        return replace(self, position_sign=signs, zero=zeros)

    def with_torque(self, joints: Sequence[int], factor: float) -> Reading:
        """Torques of some joints, by index among those that have one, multiplied by a factor."""
        factors = self.torque_factor.copy()
        factors[list(joints)] *= factor
        return replace(self, torque_factor=factors)

    def joined_torques(self, joints: Sequence[int] | Indices) -> Array:
        """What makes torques of those of the motors, ``(n_torques, n_torques)``; ``joints``: which have one."""
        return np.asarray(np.linalg.inv(self.joined)[:, joints][joints].T)

    def with_wrenches(self, sensors: Sequence[int], matrix: Array) -> Reading:
        """Wrenches of some sensors turned by a matrix ``(6, 6)``."""
        maps = self.wrench_map.copy()
        maps[list(sensors)] = matrix @ maps[list(sensors)]
        return replace(self, wrench_map=maps)

    def of(self, log: Log) -> Log:
        """The log with its channels put right."""
        # Without weight torques are those of a robot that has none: what they tell is identified so.
        gravity = np.zeros(3) if self.weightless else self.gravity
        header = log.header.model_copy(update={"gravity": tuple(float(x) for x in gravity)})
        columns = [log.header.joints.index(joint) for joint in log.header.torque_joints]
        sensors = tuple(sensor.name for sensor in log.header.sensors)
        trials = tuple(self._trial(trial, columns, sensors) for trial in log.trials)
        return replace(log, header=header, trials=trials)

    def _trial(self, trial: Trial, columns: list[int], sensors: tuple[str, ...]) -> Trial:
        time, factor = trial.time, self.position_sign * self.unit
        at = time + self.late_s / self.tick

        def moved(values: Array | None, zero: Array | float = 0.0) -> Array | None:
            return None if values is None else values[:, self.position_of] * factor @ self.joined.T + zero

        def shifted(values: Array) -> Array:
            if self.late_s == 0.0:
                return values
            return np.column_stack([np.interp(at, time, column) for column in values.T])

        def forces(values: Array | None, factors: Array | float = 1.0) -> Array | None:
            if values is None:
                return None
            found = values.astype(float)
            found[:, columns] = (
                found[:, columns][:, self.torque_of] @ self.joined_torques(columns).T * factors
            )
            return shifted(found)

        q = trial.q[:, self.position_of] * factor @ self.joined.T + self.zero
        marked = forces(trial.beyond)  # type: ignore[arg-type]
        # Of sensors that the log does not describe readings stay as they are.
        wrenches = dict(trial.wrenches)
        for name, other, matrix, added in zip(
            sensors, self.sensor_of, self.wrench_map, self.wrench_added, strict=True
        ):
            if sensors[other] in trial.wrenches:
                wrenches[name] = trial.wrenches[sensors[other]] @ matrix.T + added
        read = replace(
            trial,
            time=time if self.tick == 1.0 else time[0] + self.tick * (time - time[0]),
            q=q,
            q_cmd=_nearer(trial.q_cmd, moved(trial.q_cmd, self.zero), q),
            v=moved(trial.v),
            a=moved(trial.a),
            tau=forces(trial.tau, self.torque_factor),
            current=forces(trial.current, self.torque_factor),
            beyond=None if marked is None else marked != 0.0,
            base=None if trial.base is None else self.pose.read(trial.base),
            wrenches={name: shifted(values) for name, values in wrenches.items()},
        )
        logged = (at >= time[0]) & (at <= time[-1])
        return read if logged.all() or logged.mean() < OWN_SHARE else read.rows(logged)


def _nearer(as_logged: Array | None, moved: Array | None, q: Array) -> Array | None:
    """Commands as they were logged or read as the positions are: each joint's column that is nearer to its position."""
    if as_logged is None or moved is None:
        return None
    miss = [((values - q) ** 2).mean(axis=0) for values in (as_logged, moved)]
    return np.where(miss[0] < miss[1], as_logged, moved)
