"""How much of each part of the nominal model is in torques: about one where it is, about nought where it is not."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.doctor.drive_fit import beside_drives
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import TorqueSamples
from excite.finding import list_names


class ModelParts(NamedTuple):
    """Shares of the model's parts, nan where a joint's torque does not tell.

    Attributes:
        joints: those that have a torque.
        weight: ``(n_torques,)`` of the bodies' weight.
        inertia: likewise, of what their inertia asks for.
    """

    joints: tuple[str, ...]
    weight: Array
    inertia: Array

    @property
    def told(self) -> NDArray[np.bool_]:
        """Which joints tell anything, ``(n_torques,)``."""
        return np.isfinite(self.weight) | np.isfinite(self.inertia)

    @property
    def largest(self) -> float:
        """The largest share of any part at any joint, either sign; nan where none tells."""
        shares = np.abs(np.concatenate([self.weight, self.inertia]))
        return float(np.nanmax(shares)) if self.told.any() else np.nan

    def said(self) -> str:
        """Shares by joint, in words."""
        told = [
            f"{joint} {' and '.join('?' if np.isnan(x) else f'{x:.2g}' for x in shares)}"
            for joint, *shares in zip(self.joints, self.weight, self.inertia, strict=True)
            if np.isfinite(shares).any()
        ]
        return f"shares of the nominal weight and inertial forces in them: {list_names(told, 3)}"

    def figures(self) -> dict[str, float]:
        """The same as numbers by name."""
        return {
            f"{part}.{joint}": float(share)
            for part, shares in (("weight", self.weight), ("inertia", self.inertia))
            for joint, share in zip(self.joints, shares, strict=True)
            if np.isfinite(share)
        }


def parts_in(samples: TorqueSamples, reading: Reading) -> ModelParts:
    """Shares of weight and inertial forces in each torque by least squares, beside the joint's offset, friction, rotor.

    Args:
        samples: torques beside the nominal model's.
        reading: how the channels are read.
    """
    full, drive = samples.predicted(reading)
    still = samples.predicted(replace(reading, gravity=np.zeros(3))).torque
    torque = samples.measured_torque(reading)
    shares = np.full((2, torque.shape[1]), np.nan)
    pairs = [beside_drives(torque, part, drive) for part in (full - still, still)]
    for j, ((own, weight), (_, inertia)) in enumerate(zip(*pairs, strict=True)):
        columns = np.column_stack([weight, inertia])
        fitted = np.linalg.lstsq(columns, own, rcond=None)[0]
        # A part tells its share where all of it would be larger than what nothing explains: that is other physics,
        # alike over whole motions, and no noise.
        told = np.linalg.norm(columns, axis=0) > np.linalg.norm(own - columns @ fitted)
        shares[:, j] = np.where(told, fitted, np.nan)
    return ModelParts(samples.channels, *shares)
