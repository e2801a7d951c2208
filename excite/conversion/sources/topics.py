"""Topics of a bag as one recording, whichever library decodes their messages."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from excite.conversion.recording import Recording
from excite.conversion.sources.gathered import Gathered
from excite.conversion.sources.messages import decode, is_trajectory, stamp_s, trajectory_rows
from excite.errors import LogError

# Two stamps of one message that differ by more come from different clocks [s].
_OTHER_CLOCK_S = 3600.0


class Topics:
    """Collects messages of a bag."""

    def __init__(self) -> None:
        self._topics: dict[str, Gathered] = {}
        self._planned: dict[str, Gathered] = {}

    def add(self, topic: str, kind: str, message: Any, logged_s: float) -> None:
        """One message: at its header's stamp where that is from the same clock, else at the time it was written."""
        if is_trajectory(kind):
            if topic in self._planned or not message.points:
                return
            gathered = self._planned.setdefault(topic, Gathered(topic))
            for time, (fields, values) in trajectory_rows(message):
                gathered.add(time, fields, values)
            return
        fields, values = decode(kind, message, topic)
        if not fields:
            return
        stamp = stamp_s(message)
        time = stamp if stamp is not None and abs(stamp - logged_s) < _OTHER_CLOCK_S else logged_s
        self._topics.setdefault(topic, Gathered(topic)).add(time, fields, values)

    @property
    def any(self) -> bool:
        """Whether anything was collected."""
        return bool(self._topics or self._planned)

    def recording(self, path: Path, there: Mapping[str, str]) -> Recording:
        """All that was collected; raises LogError where no message is of a type that is read.

        Args:
            path: of the bag.
            there: types by topic, for the error.
        """
        measured = bool(self._topics)
        kept = self._topics if measured else self._planned
        start = min((gathered.first_s for gathered in kept.values()), default=0.0)
        streams = tuple(s for g in kept.values() if (s := g.stream(start)) is not None)
        if not streams:
            shown = ", ".join(f"{topic} ({kind})" for topic, kind in list(there.items())[:8]) or "nothing"
            raise LogError(
                f"has no topic with joint states; it has {shown}",
                source=path,
                remedy="record sensor_msgs/JointState, the controller's state, or Unitree's LowState",
            )
        notes = [g.note for g in kept.values() if g.note]
        if not measured:
            notes.append("it holds a planned motion and no measurement")
        name = path.stem if path.suffix else path.name
        return Recording(str(path), name, streams, notes=tuple(notes))
