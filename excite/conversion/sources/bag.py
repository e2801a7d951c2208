"""ROS 1 bags (``.bag``), and ROS 2 bags (folders, ``.db3``), through rosbags."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

from excite.conversion.recording import Recording
from excite.conversion.sources.ros.any_message import MOST_BYTES
from excite.conversion.sources.ros.controller_types import KIND, register_interfaces, register_state
from excite.conversion.sources.ros.messages import is_trajectory, is_wanted
from excite.conversion.sources.ros.topics import Topics, is_of_torques
from excite.conversion.sources.ros.unitree_types import register_unitree
from excite.conversion.sources.source import Source, damaged
from excite.reading.file import first_bytes


def _add_messages(topics: Topics, bag: Any, connections: Sequence[Any]) -> None:
    """Messages of some topics whose definition is known; of types that nothing is known of, small ones."""
    unreadable = set()
    for connection, logged, raw in bag.messages(connections=connections) if connections else ():
        kind = connection.msgtype
        known = is_wanted(kind) or is_trajectory(kind)
        if kind in unreadable or not (known or len(raw) <= MOST_BYTES):
            continue
        if kind not in bag.typestore.fielddefs and not (kind == KIND and register_state(bag.typestore, raw)):
            unreadable.add(kind)
            continue
        topics.add(connection.topic, kind, bag.deserialize(raw, kind), 1e-9 * logged)


class BagSource(Source):
    """Topics of joints, wrenches and base poses."""

    name: ClassVar[str] = "bag"
    summary: ClassVar[str] = "ROS 1 bags (.bag) and ROS 2 bags (folders, .db3)"
    own_process: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        if path.is_dir():
            return (path / "metadata.yaml").is_file()
        return path.suffix.lower() in {".bag", ".db3"} or first_bytes(path, 12).startswith(b"#ROSBAG V2.0")

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        import apsw
        from rosbags import rosbag1, rosbag2
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.serde import SerdeError
        from rosbags.typesys import Stores, TypesysError, get_typestore

        store = get_typestore(Stores.ROS2_HUMBLE)
        register_unitree(store)
        register_interfaces(store)
        topics = Topics()
        notes: tuple[str, ...] = ()
        try:
            bags = AnyReader([path], default_typestore=store)
            if not bags.is2:
                from excite.conversion.sources.ros.chunks import ChunkReader  # lazy: rosbags

                bags.readers = [ChunkReader(path)]
            with bags as bag:
                there = {c.topic: c.msgtype for c in bag.connections}
                wanted = [c for c in bag.connections if is_wanted(c.msgtype) or is_trajectory(c.msgtype)]
                _add_messages(topics, bag, wanted)
                others = [c for c in bag.connections if c not in wanted]
                if not topics.has_positions:
                    # Nobody's known message says where the joints were: those of any type are looked through.
                    _add_messages(topics, bag, others)
                elif topics.lacks_torques:
                    _add_messages(topics, bag, [c for c in others if is_of_torques(c.topic)])
        except (
            AnyReaderError,
            AssertionError,
            SerdeError,
            TypesysError,
            OSError,
            ValueError,
            KeyError,
            IndexError,
            AttributeError,
            TypeError,
            RuntimeError,
            OverflowError,
            struct.error,
            apsw.Error,
            rosbag1.ReaderError,
            rosbag2.ReaderError,
        ) as error:
            if not topics.has_positions:
                raise damaged(path, error, "a bag") from error
            notes = ("its end is damaged: it is read as far as it goes",)
        found = topics.recording(path, there)
        return (replace(found, notes=found.notes + notes),)
