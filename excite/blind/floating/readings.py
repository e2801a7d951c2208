"""What a standing robot's sensors make of what happens."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.simulation.recording import Recording


@dataclass(frozen=True)
class Mixed:
    """A wrench sensor whose channels are scaled or leak into each other.

    Attributes:
        sensor: its name.
        matrix: logged = matrix · true, six rows of six.
    """

    sensor: str
    matrix: tuple[tuple[float, ...], ...]

    def __call__(self, recording: Recording) -> Recording:
        """The recording with it."""
        wrench = recording.wrenches[self.sensor] @ np.array(self.matrix).T
        return replace(recording, wrenches={**recording.wrenches, self.sensor: wrench})


@dataclass(frozen=True)
class Bent:
    """A joint with a soft gear: the encoder sits on the motor's side.

    Attributes:
        joint: index of the actuated joint.
        stiffness: [N·m/rad]
        hardening: relative growth of the stiffness per N·m of load; 0 for a linear gear.
    """

    joint: int
    stiffness: float
    hardening: float = 0.0

    def __call__(self, recording: Recording) -> Recording:
        """Logged = true angle + torque / stiffness."""
        torque = recording.tau_link[:, self.joint]
        bend = torque / (self.stiffness * (1.0 + self.hardening * np.abs(torque)))
        q = recording.q.copy()
        q[:, 7 + self.joint] += bend
        return replace(recording, q=q)


@dataclass(frozen=True, eq=False)
class Wobbly:
    """Markers on soft tissue: a damped oscillator that the segment's own acceleration drives.

    Attributes:
        model: kinematics.
        joint: index of the actuated joint, the segment's first.
        gain: angle by acceleration, static, along the segment's axes, ``(3,)`` [rad·s²/m].
        hertz: of the tissue on the bone.
        ratio: its damping ratio.
    """

    model: pin.Model
    joint: int
    gain: tuple[float, float, float]
    hertz: float
    ratio: float

    def __call__(self, recording: Recording) -> Recording:
        """Logged = true angle + the tissue's."""
        from scipy.signal import cont2discrete, lfilter

        omega = 2.0 * np.pi * self.hertz
        step = float(recording.time[1] - recording.time[0])
        top, bottom, _ = cont2discrete(
            ([omega**2], [1.0, 2.0 * self.ratio * omega, omega**2]), step, method="bilinear"
        )
        q = recording.q.copy()
        q[:, 7 + self.joint] -= lfilter(np.ravel(top), bottom, self._pull(recording) @ np.array(self.gain))
        return replace(recording, q=q)

    def _pull(self, recording: Recording) -> Array:
        """World acceleration of the joint's origin, ``(n, 3)``."""
        data, rows = self.model.createData(), []
        # The universe and the free base come before the actuated joints.
        joint = self.joint + 2
        for q, v, a in zip(recording.q, recording.v, recording.a, strict=True):
            pin.forwardKinematics(self.model, data, q, v, a)
            spin, linear = data.v[joint].angular, data.v[joint].linear
            rows.append(data.oMi[joint].rotation @ (data.a[joint].linear + np.cross(spin, linear)))
        return np.array(rows)
