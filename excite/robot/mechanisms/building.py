"""Building a mechanism, closed, from the names of its passive joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.robot.mechanisms.closures import Closure
from excite.robot.mechanisms.mechanism import Mechanism


def build_mechanism(
    model: pin.Model,
    closures: Sequence[Closure],
    passive: Sequence[str],
    rest: Array | None = None,
    carrying: Sequence[int] = (),
) -> Mechanism:
    """A mechanism by the names of its passive joints, each of one coordinate, at rest near ``rest`` ``(nq,)``.

    Joints below the model joints ``carrying`` stay as ``rest`` has them where others can close it.

    Raises:
        MotionError: it cannot be closed there, or passive joints do not follow from the motors.
    """
    columns = sorted(int(model.idx_vs[model.getJointId(name)]) for name in passive)
    near = pin.neutral(model) if rest is None else rest
    open_ = Mechanism(model, tuple(closures), np.array(columns, dtype=np.int64), near)
    by = open_.following_from(limb_columns(model, carrying)) if carrying else open_
    closed = replace(open_, rest=by.closed(near[None])[0])
    closed.motion_maps(closed.rest[None])
    return closed


def limb_columns(model: pin.Model, joints: Sequence[int]) -> NDArray[np.int64]:
    """Indices into ``v`` of the joints of one coordinate between the base and any of ``joints``."""
    chain = sorted({int(j) for joint in joints for j in model.supports[joint]})
    return np.array([int(model.idx_vs[j]) for j in chain if model.nvs[j] == 1], dtype=np.int64)
