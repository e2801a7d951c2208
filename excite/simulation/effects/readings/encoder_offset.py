"""An encoder whose zero is off."""

from __future__ import annotations

from dataclasses import dataclass, replace

from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.recording import Recording
from excite.simulation.virtual_robot import VirtualRobot


@dataclass(frozen=True)
class _Reading:
    joint: int
    offset: float

    def __call__(self, recording: Recording) -> Recording:
        q, q_cmd = recording.q.copy(), recording.q_cmd.copy()
        column = q.shape[1] - q_cmd.shape[1] + self.joint
        q[:, column] += self.offset
        q_cmd[:, self.joint] += self.offset
        return replace(recording, q=q, q_cmd=q_cmd)


class EncoderOffset(InjectedEffect):
    """Logged = true position + offset; the servo follows the encoder, so that its command is off as well."""

    name = "encoder_offset"
    what = "an encoder whose zero is off"
    unit = "rad"
    lower, upper = -0.5, 0.5

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return virtual.robot.joint_names

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.05

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        return virtual.with_reading(_Reading(virtual.robot.joint_index(location), value))
