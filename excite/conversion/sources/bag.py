"""Messages of bags as recordings: topics of joints, wrenches and base poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.words import read_clue
from excite.conversion.recording import Recording, Stream
from excite.conversion.sources.messages import (
    MOST_BYTES,
    Gathered,
    Room,
    decode,
    decode_any,
    is_of_rows,
    is_trajectory,
    is_wanted,
    stamp_s,
    trajectory_rows,
)
from excite.conversion.sources.source import Source
from excite.conversion.sources.unitree import is_unitree, name_motors
from excite.errors import LogError
from excite.formats.bags import Bag, is_bag, is_mcap, open_bag
from excite.formats.file import is_damage

# Two stamps of one message that differ by more come from different clocks [s].
_OTHER_CLOCK_S = 3600.0


class Topics:
    """Collects messages of a bag."""

    def __init__(self) -> None:
        self._room = Room()
        self._topics: dict[str, Gathered] = {}
        self._planned: dict[str, Gathered] = {}
        self._kinds: dict[str, str] = {}

    def add(self, topic: str, kind: str, message: Any, logged_s: float | Array) -> None:
        """Messages: at their headers' stamps where these are from the same clock, else at the times of writing."""
        if is_trajectory(kind):
            if topic in self._planned or not message.points:
                return
            gathered = self._planned[topic] = Gathered(topic, self._room)
            for from_start, (fields, values) in trajectory_rows(message):
                gathered.add(from_start, fields, values)
            return
        fields, values = decode(kind, message, topic) if is_wanted(kind) else decode_any(message)
        if not fields:
            return
        self._kinds[topic] = kind
        stamp = stamp_s(message)
        time = np.where(np.abs(stamp - logged_s) < _OTHER_CLOCK_S, stamp, logged_s)
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


class BagSource(Source):
    """Bags of ROS; one whose end is damaged is read as far as it goes."""

    name: ClassVar[str] = "bag"
    what: ClassVar[str] = "a bag"
    summary: ClassVar[str] = "ROS 1 bags (.bag) and ROS 2 bags (folders, .db3)"
    own_process: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        return is_bag(path)

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        topics, there = Topics(), dict[str, str]()
        notes: tuple[str, ...] = ()
        try:
            with open_bag(path) as bag:
                there = bag.topics
                _gather(topics, bag)
        except Exception as error:
            if not is_damage(error) or not topics.any:
                raise
            notes = ("its end is damaged or missing: it is read as far as it goes",)
        found = topics.recording(path, there)
        return (replace(found, notes=found.notes + notes),)


class McapSource(BagSource):
    """Messages of ROS or in JSON; a file whose recorder was killed is read as far as it goes."""

    name: ClassVar[str] = "mcap"
    what: ClassVar[str] = "MCAP"
    summary: ClassVar[str] = "MCAP with messages of ROS 2 or ROS 1 (.mcap)"

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        return is_mcap(path)


def _gather(topics: Topics, bag: Bag) -> None:
    """Messages whose types say what they hold; where none says where joints were, small ones of any type."""
    for message in bag.messages(lambda topic, kind: _is_known(kind), together=is_of_rows):
        topics.add(*message)
    if topics.has_positions and not topics.lacks_torques:
        return
    # Where joints were is known and no torque is: topics that are called after torques or currents.
    wanted = ("tau", "i") if topics.has_positions else ()
    for message in bag.messages(
        lambda topic, kind: not _is_known(kind) and (not wanted or read_clue(topic, ()).quantity in wanted),
        MOST_BYTES,
    ):
        topics.add(*message)


def _is_known(kind: str) -> bool:
    return is_wanted(kind) or is_trajectory(kind)
