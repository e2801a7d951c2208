"""Equalities of a MuJoCo model as blocks ``loops`` and ``couplings`` of a ``robot.yaml``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.robot.mjcf.closures import MjcfClosures, find_mimics, tendon_joints

if TYPE_CHECKING:
    import mujoco

_SOURCE = "the MuJoCo model's equality"


@dataclass(frozen=True, eq=False)
class BlockWriter:
    """Writes equalities as blocks of a ``robot.yaml``.

    Attributes:
        model: the compiled model.
        closures: its equalities.
        joint_name: of a joint's number.
        link_name: of a body's number.
        anchor: of each body, where its link's frame is in the body's frame ``(3,)`` [m].
    """

    model: mujoco.MjModel
    closures: MjcfClosures
    joint_name: Callable[[int], str]
    link_name: Callable[[int], str]
    anchor: dict[int, Array]

    def loops(self) -> tuple[dict[str, Any], ...]:
        """Blocks of ``loops``."""
        import mujoco

        kinds = {mujoco.mjtEq.mjEQ_CONNECT: "point", mujoco.mjtEq.mjEQ_WELD: "weld"}
        found = [
            (number, kinds[kind])
            for number in self.closures.solved
            if (kind := mujoco.mjtEq(int(self.model.eq_type[number]))) in kinds
        ]
        return tuple(
            {
                "name": self._name(number),
                "kind": kind,
                "ends": [self._end(*end) for end in _loop_ends(self.model, number)],
                "passive": self._passive(number),
                "source": _SOURCE,
            }
            for number, kind in found
        )

    def couplings(self) -> tuple[dict[str, Any], ...]:
        """Blocks of ``couplings``."""
        import mujoco

        found, written = [], find_mimics(self.model, self.closures)
        for number in self.closures.solved:
            if int(self.model.eq_obj1id[number]) in written and self.closures.passive.get(number):
                continue
            kind, data = mujoco.mjtEq(int(self.model.eq_type[number])), self.model.eq_data[number]
            ends = [int(self.model.eq_obj1id[number]), int(self.model.eq_obj2id[number])]
            if kind == mujoco.mjtEq.mjEQ_JOINT:
                powers = [-float(x) for x in np.trim_zeros(data[1:5], "b")] or [0.0]
                joints: dict[int, list[float]] = {ends[0]: [1.0], ends[1]: powers}
            elif kind == mujoco.mjtEq.mjEQ_TENDON:
                joints = {joint: [factor] for joint, factor in tendon_joints(self.model, ends[0])}
                for joint, factor in tendon_joints(self.model, ends[1]) if ends[1] >= 0 else ():
                    joints[joint] = [joints.get(joint, [0.0])[0] - float(data[1]) * factor]
            else:
                continue
            found.append(
                {
                    "name": self._name(number),
                    "joints": {
                        self.joint_name(joint): factors[0] if len(factors) == 1 else factors
                        for joint, factors in joints.items()
                    },
                    "offset": float(data[0]),
                    "passive": self._passive(number),
                    "source": _SOURCE,
                }
            )
        return tuple(found)

    def _name(self, number: int) -> str:
        return self.model.equality(number).name or f"equality_{number}"

    def _passive(self, number: int) -> list[str]:
        return [self.joint_name(joint) for joint in sorted(self.closures.passive.get(number, ()))]

    def _end(self, body: int, place: pin.SE3) -> dict[str, Any]:
        link = pin.SE3(np.eye(3), -self.anchor.get(body, np.zeros(3))) * place
        rpy = pin.rpy.matrixToRpy(link.rotation)
        return {
            "link": self.link_name(body),
            "xyz": [float(x) + 0.0 for x in link.translation],
            **({"rpy": [float(x) for x in rpy]} if np.abs(rpy).max() > 0.0 else {}),
        }


def _loop_ends(model: mujoco.MjModel, number: int) -> list[tuple[int, pin.SE3]]:
    """Bodies that an equality of bodies or sites ties, and frames on them that meet."""
    import mujoco

    ids = (int(model.eq_obj1id[number]), int(model.eq_obj2id[number]))
    if model.eq_objtype[number] == mujoco.mjtObj.mjOBJ_SITE:
        return [(int(model.site_bodyid[k]), _pose_of(model.site_pos[k], model.site_quat[k])) for k in ids]
    data, level = model.eq_data[number], np.array([1.0, 0.0, 0.0, 0.0])
    if model.eq_type[number] == mujoco.mjtEq.mjEQ_CONNECT:
        return [(ids[0], _pose_of(data[:3], level)), (ids[1], _pose_of(data[3:6], level))]
    return [(ids[0], _pose_of(data[3:6], data[6:10])), (ids[1], _pose_of(data[:3], level))]


def _pose_of(position: Array, quaternion: NDArray[np.float64]) -> pin.SE3:
    w, x, y, z = (float(value) for value in quaternion)
    return pin.SE3(pin.Quaternion(w, x, y, z).normalized().matrix(), np.array(position, dtype=float))
