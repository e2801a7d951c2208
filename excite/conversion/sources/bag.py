"""Messages of bags as recordings: topics of joints, wrenches and base poses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from excite.conversion.recording import Recording
from excite.conversion.sources.messages import MOST_BYTES, is_trajectory, is_wanted
from excite.conversion.sources.source import Source
from excite.conversion.sources.topics import Topics, is_of_torques
from excite.errors import LogError
from excite.formats.bags import Bag, is_bag, is_mcap, open_bag
from excite.formats.file import is_damage


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
            with open_bag(path, LogError) as bag:
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
    for message in bag.messages(lambda topic, kind: _is_known(kind)):
        topics.add(*message)
    if topics.has_positions and not topics.lacks_torques:
        return
    # Where joints were is known and no torque is: topics that are called after torques.
    of_torques = topics.has_positions
    for message in bag.messages(
        lambda topic, kind: not _is_known(kind) and (not of_torques or is_of_torques(topic)), MOST_BYTES
    ):
        topics.add(*message)


def _is_known(kind: str) -> bool:
    return is_wanted(kind) or is_trajectory(kind)
