"""ROS 1 bags chunk by chunk: in memory for as long as a chunk is, however many messages the bag has."""

from __future__ import annotations

import os
from collections.abc import Collection, Generator, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader, ReaderError
from rosbags.rosbag1.reader import Header, IndexData, RecordType, read_bytes, read_uint32


class ChunkReader(Reader):
    """rosbags' reader without the index of all messages, which takes 140 bytes for each of them.

    Messages come in the order in which they were written, which is that of their times but for a queue's length.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)

    def read_index_data(self, pos: int, indexes: dict[int, list[IndexData]]) -> None:
        """Nothing of a chunk's index is needed."""

    def messages(
        self,
        connections: Collection[Connection] = (),
        start: int | None = None,
        stop: int | None = None,
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Connection, time [ns] and bytes of each message; of all connections where none are named.

        Raises:
            ReaderError: a chunk is damaged.
        """
        wanted = {connection.id: connection for connection in connections or self.connections}
        for info in self.chunk_infos:
            if not wanted.keys() & info.connection_counts.keys():
                continue
            for header, data in self._records(self.chunks[info.pos]):
                connection = wanted.get(header.get_uint32("conn"))
                if connection is None:
                    continue
                time = header.get_time("time")
                if (start is None or time >= start) and (stop is None or time < stop):
                    yield connection, time, data

    def _records(self, place: Any) -> Iterator[tuple[Header, bytes]]:
        """Headers and bytes of the messages of a chunk."""
        if self.bio is None:
            raise ReaderError("Bag is not open.")
        self.bio.seek(place.datapos)
        content = place.decompressor(read_bytes(self.bio, place.datasize))
        chunk = BytesIO(content)
        while chunk.tell() < len(content):
            header = Header.read(chunk)
            size = read_uint32(chunk)
            if header.get_uint8("op") == RecordType.MSGDATA:
                yield header, read_bytes(chunk, size)
            else:
                chunk.seek(size, os.SEEK_CUR)
