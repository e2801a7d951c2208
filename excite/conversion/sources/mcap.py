"""MCAP files: messages of ROS 2 and ROS 1 by the schemas embedded in them, without ROS."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from excite.conversion.recording import Recording
from excite.conversion.sources.messages import MOST_BYTES, is_trajectory, is_wanted
from excite.conversion.sources.source import Source
from excite.conversion.sources.topics import Topics, is_of_torques
from excite.errors import LogError
from excite.formats.file import first_bytes, is_damage

# How a channel's bytes are decoded, by the encoding that it states.
_BYTES = {"cdr": "deserialize_cdr", "ros1": "deserialize_ros1"}
# Concatenated definitions in IDL stand between lines of these.
_IDL_RULE = "=" * 80 + "\n"


class McapSource(Source):
    """Topics of joints, wrenches and base poses; a file whose recorder was killed is read as far as it goes."""

    name: ClassVar[str] = "mcap"
    what: ClassVar[str] = "MCAP"
    summary: ClassVar[str] = "MCAP with messages of ROS 2 or ROS 1 (.mcap)"
    own_process: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        return path.is_file() and (path.suffix.lower() == ".mcap" or first_bytes(path, 8) == b"\x89MCAP0\r\n")

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        try:
            from mcap.reader import NonSeekingReader
        except ImportError as error:
            raise LogError(
                "is MCAP, which needs mcap", source=path, remedy="pip install 'excite[ros]'"
            ) from error
        topics, there = Topics(), dict[str, str]()
        decode = _Decoder()
        notes: tuple[str, ...] = ()
        try:
            for known in (True, False):
                # Where no known message says where the joints were, those of any type are looked through; where none
                # holds torques, topics that are called after them.
                if known or not topics.has_positions or topics.lacks_torques:
                    of_torques = not known and topics.has_positions
                    with path.open("rb") as stream:
                        reader = NonSeekingReader(stream, validate_crcs=False)
                        messages = reader.iter_messages(log_time_order=False)
                        if of_torques:
                            messages = (m for m in messages if is_of_torques(m[1].topic))
                        _add_messages(topics, there, decode, messages, known=known)
        except Exception as error:
            if not is_damage(error) or not topics.any:
                raise
            notes = ("its end is missing: it is read as far as it goes",)
        found = topics.recording(path, there)
        return (Recording(found.source, found.name, found.streams, found.said, found.notes + notes),)


class _Decoder:
    """Decodes messages of ROS by their schemas, and those in JSON."""

    def __init__(self) -> None:
        self._of: dict[int, Callable[[bytes], Any] | None] = {}

    def __call__(self, schema: Any, channel: Any) -> Callable[[bytes], Any] | None:
        """What decodes a channel's messages; None for an encoding or a definition that is not known."""
        if channel.id not in self._of:
            self._of[channel.id] = (
                json.loads if channel.message_encoding == "json" else _by_definition(schema, channel)
            )
        return self._of[channel.id]


def _by_definition(schema: Any, channel: Any) -> Callable[[bytes], Any] | None:
    """What decodes messages of ROS; None where the definition is of no language that is known, or has mistakes."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
    from rosbags.typesys.msg import normalize_msgtype

    if schema is None or channel.message_encoding not in _BYTES:
        return None
    text = schema.data.decode(errors="replace")
    # Definitions leave out what every installation has.
    usual = get_typestore(Stores.ROS2_HUMBLE).fielddefs
    types = {name: usual[name] for name in ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")}
    try:
        if schema.encoding in ("ros2msg", "ros1msg"):
            types |= get_types_from_msg(text, schema.name)
        elif schema.encoding in ("ros2idl", "omgidl"):
            parts = text.split(_IDL_RULE)[1:] or [text]
            for part in parts:
                types |= get_types_from_idl(part.partition("\n")[2] if part.startswith("IDL: ") else part)
        else:
            return None
        store = get_typestore(Stores.EMPTY)
        store.register(types)
        kind = normalize_msgtype(schema.name)
        store.get_msgdef(kind)
    except Exception as error:
        if not is_damage(error):
            raise
        return None
    return partial(getattr(store, _BYTES[channel.message_encoding]), typename=kind)


def _add_messages(
    topics: Topics, there: dict[str, str], decode: _Decoder, messages: Any, *, known: bool
) -> None:
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
