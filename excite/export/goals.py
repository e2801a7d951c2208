"""What a ROS 2 joint trajectory controller takes for one goal."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from excite.arrays import Array
from excite.motion.motion import Motion

# ros2_controllers takes a velocity for zero up to the epsilon of single precision, and since Jazzy refuses goals that
# end with another one (allow_nonzero_velocity_at_trajectory_end).
_ZERO = float(np.finfo(np.float32).eps)


def goal_velocities(motion: Motion) -> Array:
    """Velocities of the joints, ``(n, n_joints)``; the last are zero where no other motion goes on from there.

    The check has found that the motion ends at rest, up to half a percent of each velocity limit; a controller would
    refuse the whole for less than that.
    """
    velocities = motion.joint_velocities().copy()
    rests = not motion.metadata.following and (motion.metadata.verdict or {}).get("safe")
    if rests and np.abs(velocities[-1]).max() > _ZERO:
        velocities[-1] = 0.0
    return velocities


def between_rests(motion: Motion) -> list[Motion]:
    """Parts of a motion between instants at which all joints stand still, each from and to rest; both own the instant.

    Each begins at its own time, so that the parts in order, and the times between them, are the motion.
    """
    still = np.abs(motion.joint_velocities()).max(axis=1) <= _ZERO
    # The first sample of each time at rest; whoever waits there, waits in the next part.
    cuts = np.flatnonzero(still[1:-1] & ~still[:-2]) + 1
    edges = [0, *cuts.tolist(), motion.n_samples - 1]
    return [
        replace(
            motion,
            time=motion.time[i : j + 1],
            q=motion.q[i : j + 1],
            v=motion.v[i : j + 1],
            a=motion.a[i : j + 1],
            contacts={name: flags[i : j + 1] for name, flags in motion.contacts.items()},
        )
        for i, j in pairwise(edges)
    ]
