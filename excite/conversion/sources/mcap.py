"""MCAP files: messages of ROS 2 by the schemas embedded in them, without ROS."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any, ClassVar

from excite.conversion.recording import Recording
from excite.conversion.sources.ros.any_message import MOST_BYTES
from excite.conversion.sources.ros.messages import is_trajectory, is_wanted
from excite.conversion.sources.ros.topics import Topics
from excite.conversion.sources.source import Source, damaged
from excite.errors import LogError
from excite.reading.file import first_bytes

# What decoders raise for messages that are cut short or of types that they do not know.
_DAMAGED = (
    OSError,
    ValueError,
    KeyError,
    IndexError,
    AttributeError,
    EOFError,
    TypeError,
    RuntimeError,
    OverflowError,
    struct.error,
)


class McapSource(Source):
    """Topics of joints, wrenches and base poses; a file whose recorder was killed is read as far as it goes."""

    name: ClassVar[str] = "mcap"
    summary: ClassVar[str] = "MCAP with messages of ROS 2 (.mcap)"
    own_process: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        return path.is_file() and (path.suffix.lower() == ".mcap" or first_bytes(path, 8) == b"\x89MCAP0\r\n")

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        try:
            from mcap.exceptions import McapError
            from mcap.reader import NonSeekingReader
            from mcap_ros2.decoder import DecoderFactory
        except ImportError as error:
            raise LogError(
                "is MCAP, which needs mcap and mcap-ros2-support",
                source=path,
                remedy="pip install 'excite[ros]'",
            ) from error
        topics, there = Topics(), dict[str, str]()
        decode = _Decoder(DecoderFactory())
        notes: tuple[str, ...] = ()
        try:
            for known in (True, False):
                # Where no known message says where the joints were, those of any type are looked through.
                if known or not topics.has_positions:
                    with path.open("rb") as stream:
                        reader = NonSeekingReader(stream, validate_crcs=False)
                        _add(topics, there, decode, reader.iter_messages(log_time_order=False), known=known)
        except (McapError, *_DAMAGED) as error:
            if not topics.any:
                raise damaged(path, error, "MCAP") from error
            notes = ("its end is missing: it is read as far as it goes",)
        found = topics.recording(path, there)
        return (Recording(found.source, found.name, found.streams, found.said, found.notes + notes),)


class _Decoder:
    """Decodes messages of ROS 2 by their schemas, and those in JSON."""

    def __init__(self, factory: Any) -> None:
        self._factory = factory
        self._of: dict[int, Any] = {}

    def __call__(self, schema: Any, channel: Any) -> Any:
        """What decodes a channel's messages; None for an encoding or a definition that is not known."""
        if channel.id not in self._of:
            try:
                self._of[channel.id] = (
                    json.loads
                    if channel.message_encoding == "json"
                    else self._factory.decoder_for(channel.message_encoding, schema)
                )
            except (NameError, ValueError, RuntimeError):
                # A definition that ROS 2 does not allow, such as one of ROS 1 with capitals in its names.
                self._of[channel.id] = None
        return self._of[channel.id]


def _add(topics: Topics, there: dict[str, str], decode: _Decoder, messages: Any, *, known: bool) -> None:
    """Messages of known types, or small ones of all others."""
    for schema, channel, message in messages:
        kind = schema.name if schema is not None else ""
        there[channel.topic] = kind
        as_ros = channel.message_encoding != "json" and (is_wanted(kind) or is_trajectory(kind))
        if as_ros != known or not (known or len(message.data) <= MOST_BYTES):
            continue
        decoder = decode(schema, channel)
        if decoder is not None:
            topics.add(channel.topic, kind if as_ros else "", decoder(message.data), 1e-9 * message.log_time)
