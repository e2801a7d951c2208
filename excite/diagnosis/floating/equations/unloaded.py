"""What sensors say while their foot is in the air: nothing but their own errors and the foot's weight.

The base's equation holds the sum of all sensors, in which a constant bias of one looks like that of another,
like a constant force and, in part, like wrong inertials or a tilted base. A foot in the air tells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.floating.equations.cross import cross
from excite.diagnosis.floating.equations.prior import inertial_scales
from excite.diagnosis.floating.equations.record import FloatingRecord
from excite.diagnosis.floating.equations.state import State
from excite.regressor.kernels import base_link_regressor
from excite.robot.robot import WrenchSensor

_LIFT_M = 0.012
_LARGEST_SHARE, _SHORTEST_S = 0.15, 0.6
# Beyond the sensor's own noise: kinematics, and a foot that is not modelled to the gram.
_FORCE_FLOOR, _MOMENT_FLOOR = 0.15, 0.03


@dataclass(frozen=True, eq=False)
class UnloadedRows:
    """Mean reading of each sensor over the time in each trial in which its foot is in the air.

    Attributes:
        sensors: name of the sensor of each row block.
        masks: ``(n,)`` samples of each block.
        trial: index of the trial of each block.
        std: ``(6,)`` standard deviation of the mean of each block [N, N·m].
        foot: ``(n_blocks, 6, 10·n_segments)`` change of the expected reading per unit of the foot's inertials.
        scales: ``(10·n_segments,)`` what those are expected to be off by; zero for measured segments.
    """

    sensors: tuple[str, ...]
    masks: tuple[NDArray[np.bool_], ...]
    trial: tuple[int, ...]
    std: tuple[Array, ...]
    foot: Array
    scales: Array

    def values(self, readings: dict[str, Array]) -> Array:
        """``(n_blocks, 6)`` mean readings; the expected ones are subtracted by the caller."""
        blocks = [
            readings[name][mask].mean(axis=0) for name, mask in zip(self.sensors, self.masks, strict=True)
        ]
        return np.array(blocks).reshape(-1, 6)

    def residual(self, state: State) -> Array:
        """``(6·n_blocks,)`` mean reading less expected, over its standard deviation."""
        expected = self.foot @ state.phi
        return ((self.values(state.readings) - expected) / np.array(self.std).reshape(-1, 6)).ravel()

    def foot_columns(self) -> Array:
        """``(6·n_blocks, k)`` columns of the feet's inertials in units of their scales."""
        used = np.flatnonzero(self.scales)
        columns = self.foot[:, :, used] * self.scales[used]
        return (columns / np.array(self.std).reshape(-1, 6)[:, :, None]).reshape(-1, len(used))


def find_unloaded(record: FloatingRecord, state: State) -> UnloadedRows:
    """Look for feet in the air: the foot has risen, and the sensor carries next to nothing."""
    weight = float(record.tree.phi[::10].sum() * np.linalg.norm(record.tree.gravity))
    up = -record.tree.gravity / np.linalg.norm(record.tree.gravity)
    names, masks, trials, stds, feet = [], [], [], [], []
    scales = np.zeros(len(record.tree.phi))
    for sensor in record.robot.sensors:
        foot = record.robot.foot(sensor.foot).joint
        height = state.poses.translation[:, foot] @ up
        force = np.linalg.norm(record.readings[sensor.name][:, :3], axis=1)
        ground = np.median(height[force > 0.3 * weight]) if (force > 0.3 * weight).any() else height.min()
        for index, span in enumerate(record.spans):
            mask = np.zeros(record.n_samples, dtype=bool)
            mask[span] = (height[span] > ground + _LIFT_M) & (force[span] < _LARGEST_SHARE * weight)
            if mask.sum() < _SHORTEST_S * record.rate_hz:
                continue
            names.append(sensor.name)
            masks.append(mask)
            trials.append(index)
            stds.append(_std(record.readings[sensor.name][mask], int(mask.sum()), record.rate_hz))
            feet.append(_foot_reading(record, state, sensor, mask))
        for segment in sensor.excludes:
            part = slice(10 * segment, 10 * segment + 10)
            scales[part] = inertial_scales(record.tree.phi)[part] * (1.0 if record.inertials_free else 0.1)
    shape = (0, 6, len(record.tree.phi))
    return UnloadedRows(
        tuple(names),
        tuple(masks),
        tuple(trials),
        tuple(stds),
        np.array(feet) if feet else np.zeros(shape),
        scales,
    )


def _std(readings: Array, n: int, rate_hz: float) -> Array:
    """Of the mean over ``n`` samples: the readings' own spread, about three independent numbers a second."""
    spread = readings.std(axis=0)
    floor = np.array([_FORCE_FLOOR] * 3 + [_MOMENT_FLOOR] * 3)
    return np.hypot(spread / np.sqrt(max(1.0, 3.0 * n / rate_hz)), floor)


def _foot_reading(
    record: FloatingRecord, state: State, sensor: WrenchSensor, mask: NDArray[np.bool_]
) -> Array:
    """``(6, 10·n_segments)`` mean reading per unit of the inertials beyond the sensor, sensor frame.

    The foot pulls at the sensor with minus the wrench that its own motion needs.
    """
    total = np.zeros((6, len(record.tree.phi)))
    if not sensor.excludes:
        return total
    body = base_link_regressor(record.tree, state.q[mask], state.v[mask], state.a[mask])
    rotation = (
        np.einsum("nji,njk->nik", state.poses.rotation[mask, 1], state.poses.rotation[mask, sensor.joint])
        @ sensor.placement.rotation
    )
    point = (
        state.poses.point(sensor.joint, sensor.placement.translation)[mask] - state.poses.translation[mask, 1]
    )
    point = np.einsum("nji,nj->ni", state.poses.rotation[mask, 1], point)
    for segment in sensor.excludes:
        part = slice(10 * segment, 10 * segment + 10)
        force, moment = body[:, :3, part], body[:, 3:, part]
        moment = moment - cross(point, force)
        total[:3, part] = -np.einsum("nji,njk->ik", rotation, force) / mask.sum()
        total[3:, part] = -np.einsum("nji,njk->ik", rotation, moment) / mask.sum()
    return total
