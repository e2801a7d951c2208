"""How far from the joint that carries it a body may lie."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

# No gripper or tool of the records is longer [m]; their arms are about a metre long.
_TOOL_M = 0.6
# Of larger machines as long a share of their length: an excavator's bucket hangs 1.5 m from a joint, and what it holds
# within 0.6 m was told as gains of two joints, a lighter stick, backlash, a rotor and a wrong length.
_SHARE = 0.5


def reach(model: pin.Model) -> float:
    """Largest distance of a body's parts from the joint that carries it [m].

    Args:
        model: of the robot; wherever it is mounted.
    """
    length = np.zeros(model.njoints)
    for joint in range(1, model.njoints):
        parent = model.parents[joint]
        step = np.linalg.norm(model.jointPlacements[joint].translation) if parent > 0 else 0.0
        length[joint] = length[parent] + step
    tips = [2.0 * np.linalg.norm(inertia.lever) if inertia.mass > 0.0 else 0.0 for inertia in model.inertias]
    return max(_TOOL_M, _SHARE * float((length + tips)[1:].max(initial=0.0)))
