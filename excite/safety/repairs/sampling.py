"""From path and time law to the samples of a motion."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from importlib.metadata import version
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.motion.generators.bodyparts import rest_joints
from excite.motion.motion import Motion, MotionMetadata
from excite.safety.repairs.draft import Draft, Rejection, Repair
from excite.safety.repairs.path import run_path
from excite.safety.repairs.transfers import Transfer, plan_transfer

_VERSIONS = ("excite", "pin", "placo", "toppra", "ruckig", "numpy", "scipy")
# A start this far from rest needs a transfer [rad or m].
_NEAR = 1e-9


class Sampling(Repair):
    """Samples the motion at the robot's rate, with a transfer from and to rest where it starts elsewhere."""

    name: ClassVar[str] = "sampling"

    @cached_property
    def _versions(self) -> dict[str, str]:
        return {package: version(package) for package in _VERSIONS}

    def repair(self, draft: Draft) -> Draft | Rejection:
        """A draft with a motion, or the rejection ``self_collision`` of a transfer."""
        if draft.path is None or draft.law is None:
            return draft.rejected("no_time_law", "path")
        rate = self.robot.description.sensors.rate_hz
        moved = run_path(draft.path, draft.law, rate)
        time, q, v, a = moved.time, moved.q, moved.v, moved.a
        contacts = {foot.name: draft.candidate.supports(moved.s, foot.name) for foot in self.robot.feet}
        rest = rest_joints(self.robot)
        if not self.robot.floating and np.abs(q[0] - rest).max() > _NEAR:
            there, back = (
                plan_transfer(self.robot, rest, q[0], rate),
                plan_transfer(self.robot, q[-1], rest, rate),
            )
            for part in (there, back):
                ways = part.q if self.robot.closing is None else self.robot.closing.closed(part.q)
                collision = self.probe.first(ways)
                if collision is not None:
                    near = self.probe.closest(ways[collision:])
                    return draft.rejected(
                        "self_collision",
                        f"transfer, {near.pair}",
                        value=near.distance,
                        limit=near.required,
                        posture=near.posture,
                    )
            q, v, a = _join_phases(there, (q, v, a), back)
            if self.robot.closing is not None:
                q, v, a = self.robot.closing.completed(q, v, a)
            time = np.arange(len(q)) / rate
        candidate = draft.candidate
        motion = Motion(
            name=candidate.name,
            robot=self.robot.name,
            joint_names=self.robot.joint_names,
            time=time,
            q=q,
            v=v,
            a=a,
            contacts=contacts,
            metadata=MotionMetadata(
                generator=candidate.generator,
                seed=candidate.seed,
                targets=candidate.targets,
                robot_hash=self.robot.hash,
                versions=self._versions,
            ),
        )
        return replace(draft, motion=motion)


def _join_phases(there: Transfer, middle: tuple[Array, Array, Array], back: Transfer) -> list[Array]:
    """Positions, velocities and accelerations one after the other, shared samples once."""
    parts = ((there.q, there.v, there.a), middle, (back.q, back.v, back.a))
    return [np.vstack([parts[0][k][:-1], parts[1][k], parts[2][k][1:]]) for k in range(3)]
