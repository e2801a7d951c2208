"""A body that a link carries and the model does not have, beside a scale of the torques: which explains them better."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from excite.arrays import Array
from excite.doctor.likely_bodies import FLOOR, half_log
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import TorqueSamples
from excite.regressor.kernels import joint_torque_regressor
from excite.shown import percent

# Half the logarithm of the torques' power that a load has to leave less of than the best scale of every joint does. Two
# arms with loads of 0.3 to 2.7 times their own mass leave 1.5 to 3.1 less (all joints together), with torques that are
# four and five times as large 0.01 less; one kept from a scale by nothing is left to it.
_BETTER = 0.35
_PASSES = 5


class Load(NamedTuple):
    """A body that explains torques.

    Attributes:
        joint: the one that moves the link which carries it.
        mass: of it [kg]; 0 where the torques do not tell it.
        left: share of the torques' power that is left beside the drives, the largest of any joint.
        parameters: ``(10·n_segments,)`` what it adds to the model's inertial parameters [SI].
    """

    joint: str
    mass: float
    left: float
    parameters: Array

    def sentence(self) -> str:
        """What it is, in words."""
        size = f"a body of {self.mass:.3g} kg" if self.mass > 0.0 else "a body"
        return f"{size} beyond {self.joint} that the model does not have leaves {percent(100.0 * self.left)} of them"


def carried_load(samples: TorqueSamples, reading: Reading) -> Load | None:
    """The load that explains torques better than any scales of them do; None where none does.

    Beside each joint's offset, friction and rotor either every joint's nominal torque is multiplied by a factor of its
    own, or one link has ten inertial parameters more, of a body with a mass.

    Args:
        samples: torques beside the nominal model's.
        reading: how the channels are read.
    """
    torque, (model, drive) = samples.measured_torque(reading), samples.predicted(reading)
    tree = samples.under(reading.gravity)
    columns = samples.places[samples.measured]
    felt = joint_torque_regressor(tree, *samples.motion(reading))[:, columns]
    kept = [_Beside.of(torque[:, j], [x[:, j] for x in drive]) for j in range(torque.shape[1])]
    nominal = [one.rest(model[:, j]) for j, one in enumerate(kept)]
    scaled = half_log(np.array([one.by_gain(x) for one, x in zip(kept, nominal, strict=True)])).sum()
    found: list[tuple[float, Load]] = []
    for k in range(felt.shape[2] // 10):
        body = felt[:, :, 10 * k : 10 * k + 10]
        parts = [one.rest(body[:, j]) for j, one in enumerate(kept)]
        phi, left = _fitted(kept, nominal, parts)
        weighs = bool(np.abs(body[:, :, 0]).max() > 0.0)
        # What leaves more of a torque than there is of it is no explanation.
        if (weighs and phi[0] <= 0.0) or left.max() >= 1.0:
            continue
        added = np.zeros(felt.shape[2])
        added[10 * k : 10 * k + 10] = phi
        load = Load(tree.names[k + 1], float(phi[0]) if weighs else 0.0, float(left.max()), added)
        found.append((float(half_log(left).sum()), load))
    best = min(found, key=lambda pair: pair[0], default=None)
    return best[1] if best is not None and best[0] < scaled - _BETTER else None


class _Beside(NamedTuple):
    """A joint's torque without what its offset, friction and rotor explain, ``(n,)``, and what takes these out."""

    basis: Array
    torque: Array
    power: float

    @classmethod
    def of(cls, torque: Array, drive: list[Array]) -> _Beside:
        columns = np.column_stack([np.ones(len(torque)), *drive])
        basis, _ = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))
        power = max(float(((torque - torque.mean()) ** 2).sum()), 1e-300)
        return cls(basis, torque - basis @ (basis.T @ torque), power)

    def rest(self, values: Array) -> Array:
        return np.asarray(values - self.basis @ (self.basis.T @ values))

    def by_gain(self, model: Array) -> float:
        """Share of the torque's power that its model leaves, whatever its size."""
        along = float(model @ self.torque) ** 2 / max(float(model @ model), 1e-300)
        return max(float(self.torque @ self.torque) - along, 0.0) / self.power


def _fitted(kept: list[_Beside], nominal: list[Array], parts: list[Array]) -> tuple[Array, Array]:
    """Parameters of a body ``(10,)`` and the share of each joint's power that is left, weights by what that is."""
    missing = [one.torque - x for one, x in zip(kept, nominal, strict=True)]
    power = np.array([one.power for one in kept])
    left, phi = np.ones(len(kept)), np.zeros(10)
    for _ in range(_PASSES):
        weights = 1.0 / np.sqrt(power * np.maximum(left, FLOOR))
        rows = np.concatenate([w * part for w, part in zip(weights, parts, strict=True)])
        target = np.concatenate([w * x for w, x in zip(weights, missing, strict=True)])
        size = np.maximum(np.linalg.norm(rows, axis=0), 1e-12)
        phi = np.linalg.lstsq(rows / size, target, rcond=1e-8)[0] / size
        left = (
            np.array([((x - part @ phi) ** 2).sum() for x, part in zip(missing, parts, strict=True)]) / power
        )
    return phi, left
