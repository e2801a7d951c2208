"""Topics of a bag as one recording, whichever library decodes their messages."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from excite.conversion.columns.words import read_clue
from excite.conversion.recording import Recording, Stream
from excite.conversion.sources.messages import (
    decode,
    decode_any,
    is_trajectory,
    is_wanted,
    stamp_s,
    trajectory_rows,
)
from excite.conversion.sources.ros import Gathered, Room
from excite.conversion.sources.unitree import is_unitree, name_motors
from excite.errors import LogError

# Two stamps of one message that differ by more come from different clocks [s].
_OTHER_CLOCK_S = 3600.0


def is_of_torques(topic: str) -> bool:
    """Whether a topic is called after torques or currents, so that messages of any type in it may hold them."""
    return read_clue(topic, ()).quantity in ("tau", "i")


class Topics:
    """Collects messages of a bag."""

    def __init__(self) -> None:
        self._room = Room()
        self._topics: dict[str, Gathered] = {}
        self._planned: dict[str, Gathered] = {}
        self._kinds: dict[str, str] = {}

    def add(self, topic: str, kind: str, message: Any, logged_s: float) -> None:
        """One message: at its header's stamp where that is from the same clock, else at the time it was written."""
        if is_trajectory(kind):
            if topic in self._planned or not message.points:
                return
            gathered = self._planned[topic] = Gathered(topic, self._room)
            for time, (fields, values) in trajectory_rows(message):
                gathered.add(time, fields, values)
            return
        fields, values = decode(kind, message, topic) if is_wanted(kind) else decode_any(message)
        if not fields:
            return
        self._kinds[topic] = kind
        stamp = stamp_s(message)
        time = stamp if stamp is not None and abs(stamp - logged_s) < _OTHER_CLOCK_S else logged_s
        if topic not in self._topics:
            self._topics[topic] = Gathered(topic, self._room)
        self._topics[topic].add(time, fields, values)

    @property
    def has_positions(self) -> bool:
        """Whether a message said that it holds positions of joints, measured or planned."""
        return bool(self._planned) or any(g.has_channel("q") for g in self._topics.values())

    @property
    def lacks_torques(self) -> bool:
        """Whether no message said that it holds torques of joints: drivers may leave efforts empty."""
        return not any(g.has_channel("tau") for g in self._topics.values())

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
        streams = [(topic, s) for topic, g in kept.items() if (s := g.stream(start)) is not None]
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
        said: dict[str, Any] = {}
        found: list[Stream] = []
        family = [(self._kinds[topic], s) for topic, s in streams if is_unitree(self._kinds.get(topic, ""))]
        if family:
            named = name_motors(family)
            found, said = named.streams, named.said
            notes += named.notes
        found = [s for topic, s in streams if not is_unitree(self._kinds.get(topic, ""))] + found
        name = path.stem if path.suffix else path.name
        return Recording(str(path), name, tuple(found), said, notes=tuple(notes))
