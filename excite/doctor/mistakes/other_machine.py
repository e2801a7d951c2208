"""Another machine than the model's, beside several mistakes in a log: one cause instead of many.

The torques of a robot twice as long as its model look as if they were in another unit and on another clock: of links λ
times as long and μ times as heavy the weights grow with μ λ and what inertia asks for with μ λ², as in a time that is
√λ times as slow (Froude's number). So before several mistakes are believed, it is asked whether any bodies at all
explain the log as it stands, on the model's joints or on those of one that is larger or smaller. A turned sign, an
exchanged joint, one torque in another unit they do not explain: no mass is negative, and what one joint carries those
before it carry, too.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy

from excite.arrays import Array
from excite.doctor.likely_bodies import FLOOR, half_log
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import TorqueSamples
from excite.regressor.kernels import joint_torque_regressor

# Point masses on cubes about each joint, half as wide as so many times the distance of its nominal centre of mass, with
# a few centimetres [m] more: corners and middles of the faces. A UR10e's torques so are explained on the joints of a
# UR3, whose links are less than half as long, to 0.6 % of their power, as they are by the UR10e's own model.
_WIDE = (0.5, 1.5, 4.0)
_LEAST_M, _MOST_M = 0.04, 1.0
_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_PLACES = np.vstack([np.zeros(3), *(wide * np.vstack([_CORNERS, np.eye(3), -np.eye(3)]) for wide in _WIDE)])
_PASSES = 4
_TRACE = 1e-9


class OtherMachine(NamedTuple):
    """What explains torques with other bodies than the model's.

    Attributes:
        left: half the logarithm of each torque's share of power that is left, ``(n_torques,)``.
        length: its lengths per those of the model.
    """

    left: Array
    length: float

    @property
    def share(self) -> float:
        """Share of the torques' power that is left, geometric mean."""
        return float(np.exp(2.0 * self.left.mean()))


def other_machine(samples: TorqueSamples, stated: Reading, tick: float) -> OtherMachine:
    """The best of all bodies on the model's joints, or on joints as far apart as a clock would have them.

    Args:
        samples: torques with the motion that they belong to.
        stated: how the log states its channels.
        tick: seconds of a unit of the stamps by which the model's own lengths would do.
    """
    made = (
        OtherMachine(left_by_any_bodies(samples, replace(stated, tick=clock)), (stated.tick / clock) ** 2)
        for clock in dict.fromkeys((stated.tick, tick))
    )
    return min(made, key=lambda other: float(other.left.sum()))


def left_by_any_bodies(samples: TorqueSamples, reading: Reading) -> Array:
    """Half the logarithm of each torque's share of power that the best of all bodies leave, ``(n_torques,)``.

    Bodies are clouds of point masses of whatever size, none negative, beside each joint's offset, friction and rotor.

    Args:
        samples: torques with the motion that they belong to.
        reading: how the channels are read.
    """
    torque, drive = samples.measured_torque(reading), samples.predicted(reading).drive
    tree = samples.under(reading.gravity)
    clouds = _clouds(tree.phi.reshape(-1, 10))
    body = joint_torque_regressor(tree, *samples.motion(reading))[:, samples.places[samples.measured]]
    scale = np.maximum(torque.std(axis=0), 1e-12)
    n, m, k = *torque.shape, clouds.shape[1]
    grams, rights, places = [], [], []
    for j in range(m):
        one = np.ones(n)
        own = np.column_stack([one, -one, *(values[:, j] for values in drive)])
        own = own / np.maximum(np.sqrt((own**2).mean(axis=0)), 1e-12)
        rows = np.column_stack([body[:, j] @ clouds / scale[j], own])
        grams.append(rows.T @ rows / n)
        rights.append(rows.T @ (torque[:, j] / scale[j]) / n)
        places.append(np.r_[np.arange(k), k + own.shape[1] * j + np.arange(own.shape[1])])
    powers, size = ((torque / scale) ** 2).mean(axis=0), int(places[-1][-1]) + 1
    shares = np.full(m, 0.1)
    for _ in range(_PASSES):
        matrix, right = np.zeros((size, size)), np.zeros(size)
        for weight, place, gram, side in zip(
            1.0 / np.maximum(shares, FLOOR), places, grams, rights, strict=True
        ):
            matrix[place[:, None], place] += weight * gram
            right[place] += weight * side
        unit = np.sqrt(np.maximum(np.diag(matrix), 1e-30))
        root = np.linalg.cholesky(matrix / np.outer(unit, unit) + _TRACE * np.eye(size))
        x = scipy.optimize.nnls(root.T, np.linalg.solve(root, right / unit), maxiter=20 * size)[0] / unit
        parts = [x[place] for place in places]
        shares = np.array(
            [powers[j] - 2.0 * part @ rights[j] + part @ grams[j] @ part for j, part in enumerate(parts)]
        )
    return half_log(shares)


def _clouds(phi: Array) -> Array:
    """Inertial parameters of all bodies per unit of each point mass, ``(10·n_segments, n)``, from nominal ``phi``."""
    arm = np.linalg.norm(phi[:, 1:4], axis=1) / np.maximum(phi[:, 0], 1e-9)
    clouds = np.zeros((len(phi), 10, len(phi), len(_PLACES)))
    for k, size in enumerate(np.minimum(arm, _MOST_M) + _LEAST_M):
        r = size * _PLACES
        inertia = (r**2).sum(axis=1)[:, None, None] * np.eye(3) - r[:, :, None] * r[:, None, :]
        moments = [inertia[:, a, b] for a, b in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
        clouds[k, :, k] = np.array([np.ones(len(r)), *r.T, *moments])
    return clouds.reshape(10 * len(phi), -1)
