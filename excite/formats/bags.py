"""Recordings of messages: ROS 1 and ROS 2 bags and MCAP, decoded without ROS by the definitions that they bring."""

from __future__ import annotations

import json
import sys
from abc import ABC, abstractmethod
from collections import ChainMap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

from excite.data_tables import read_rows
from excite.errors import InputError
from excite.formats.file import first_bytes, is_damage

# Of a topic and the type of its messages, whether they are wanted.
Choice = Callable[[str, str], bool]
_MCAP = b"\x89MCAP0\r\n"


class Message(NamedTuple):
    """A message: its topic, its type (empty for JSON), its fields as attributes or entries, when it was written [s]."""

    topic: str
    kind: str
    content: Any
    logged_s: float


class Bag(ABC):
    """A recording of messages.

    Attributes:
        topics: types by topic; of a file without an index those that were met so far.
        custom: what its writer kept beside the messages.
    """

    def __init__(self) -> None:
        self.topics: dict[str, str] = {}
        self.custom: dict[str, str] = {}

    @abstractmethod
    def messages(self, wanted: Choice, most_bytes: int = sys.maxsize) -> Iterator[Message]:
        """Messages that are wanted and not larger, of definitions that are known; raises what its library raises."""


def is_mcap(path: Path) -> bool:
    """Whether a file is MCAP, by its ending or its first bytes."""
    return path.is_file() and (path.suffix.lower() == ".mcap" or first_bytes(path, len(_MCAP)) == _MCAP)


def is_bag(path: Path) -> bool:
    """Whether a file or folder is a ROS bag."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file()
    return path.suffix.lower() in {".bag", ".db3"} or first_bytes(path, 12) == b"#ROSBAG V2.0"


@contextmanager
def open_bag(path: Path, *, indexed: bool = False) -> Iterator[Bag]:
    """The messages of a file or folder; ``indexed``: MCAP, too, by its index, with what its writer kept beside them.

    Raises what its library raises, and InputError where that library is not there.
    """
    if is_mcap(path) and not indexed:
        yield _Mcap(path)
        return
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(_own_types())
    with AnyReader([path], default_typestore=store) as bag:
        yield _RosBag(bag)


class _RosBag(Bag):
    """A bag of ROS through rosbags."""

    def __init__(self, bag: Any) -> None:
        super().__init__()
        self._bag = bag
        self.topics = {c.topic: c.msgtype for c in bag.connections}
        self.custom = dict(getattr(getattr(bag.readers[0], "metadata", None), "custom", None) or {})

    def messages(self, wanted: Choice, most_bytes: int = sys.maxsize) -> Iterator[Message]:
        """See :class:`Bag`."""
        bag, unknown = self._bag, set()
        connections = [c for c in bag.connections if wanted(c.topic, c.msgtype)]
        for connection, logged, raw in bag.messages(connections=connections) if connections else ():
            kind = connection.msgtype
            if kind in unknown or len(raw) > most_bytes:
                continue
            if kind not in bag.typestore.fielddefs and not (
                kind == _STATE and _register_state(bag.typestore, raw)
            ):
                unknown.add(kind)
                continue
            yield Message(connection.topic, kind, bag.deserialize(raw, kind), 1e-9 * logged)


class _Mcap(Bag):
    """A file of MCAP, from its beginning on: one whose recorder was killed has no index."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        try:
            from mcap.reader import NonSeekingReader
        except ImportError as reason:
            raise InputError(
                "is MCAP, which needs mcap", source=path, remedy="pip install 'excite[ros]'"
            ) from reason
        self._path, self._reader = path, NonSeekingReader
        self._decoders: dict[int, Callable[[bytes], Any] | None] = {}

    def messages(self, wanted: Choice, most_bytes: int = sys.maxsize) -> Iterator[Message]:
        """See :class:`Bag`."""
        with self._path.open("rb") as stream:
            reader = self._reader(stream, validate_crcs=False)
            for schema, channel, message in reader.iter_messages(log_time_order=False):
                self.topics[channel.topic] = getattr(schema, "name", "")
                kind = "" if channel.message_encoding == "json" else self.topics[channel.topic]
                if not wanted(channel.topic, kind) or len(message.data) > most_bytes:
                    continue
                if channel.id not in self._decoders:
                    as_json = channel.message_encoding == "json"
                    self._decoders[channel.id] = json.loads if as_json else _by_definition(schema, channel)
                decoder = self._decoders[channel.id]
                if decoder is not None:
                    yield Message(channel.topic, kind, decoder(message.data), 1e-9 * message.log_time)


# How a channel's bytes are decoded, by the encoding that it states.
_BYTES = {"cdr": "deserialize_cdr", "ros1": "deserialize_ros1"}
# Concatenated definitions in IDL stand between lines of these.
_IDL_RULE = "=" * 80 + "\n"


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


# Definitions for bags that do not bring them. The controller's state of control_msgs has had three layouts.

_STATE = "control_msgs/msg/JointTrajectoryControllerState"
_POINT, _MANY = "trajectory_msgs/JointTrajectoryPoint", "trajectory_msgs/MultiDOFJointTrajectoryPoint"
_NAMES = "std_msgs/Header header\nstring[] joint_names\n"


def _point_fields(kind: str, *names: str) -> str:
    return "".join(f"{kind} {name}\n" for name in names)


_HUMBLE = _NAMES + _point_fields(_POINT, "desired", "actual", "error")
_IRON = (
    _NAMES
    + _point_fields(_POINT, "reference", "feedback", "error", "output")
    + "string[] multi_dof_joint_names\n"
    + _point_fields(_MANY, "multi_dof_reference", "multi_dof_feedback", "multi_dof_error", "multi_dof_output")
)
_LAYOUTS = (_IRON + "float64 speed_scaling_factor\n", _IRON, _HUMBLE)


def _register_state(store: Any, raw: bytes) -> bool:
    """Add the layout of the controller's state that a message follows to its last byte; False where none does."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    for layout in _LAYOUTS:
        types = get_types_from_msg(layout, _STATE)
        trial = get_typestore(Stores.ROS2_HUMBLE)
        trial.register(types)
        try:
            message: Any = trial.deserialize_cdr(raw, _STATE)
        except Exception as error:
            if not is_damage(error):
                raise
            continue
        points = (
            [message.desired, message.actual] if layout is _HUMBLE else [message.reference, message.feedback]
        )
        if any(len(point.positions) == len(message.joint_names) > 0 for point in points):
            store.register(types)
            return True
    return False


@cache
def _own_types() -> dict[str, Any]:
    """Types of ``message_definitions.csv``."""
    from rosbags.typesys import get_types_from_msg

    rows = read_rows(__file__, "message_definitions.csv")
    return dict(
        ChainMap(*(get_types_from_msg(row["fields"].replace("; ", "\n"), row["type"]) for row in rows))
    )
