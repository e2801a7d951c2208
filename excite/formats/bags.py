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
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from excite.data_tables import read_rows
from excite.errors import InputError
from excite.formats.file import first_bytes, is_damage

# Of a topic and the type of its messages, whether they are wanted.
Choice = Callable[[str, str], bool]
# Messages that are read together: their bytes are kept until then.
_LONGEST_RUN = 512
_MCAP = b"\x89MCAP0\r\n"


class Message(NamedTuple):
    """A message: its topic, its type (empty for JSON), its fields as attributes or entries, when it was written [s].

    Of ``n`` messages that differ in their numbers alone each number is an array ``(n,)``, and each list of k numbers
    ``(k, n)``; so are the times ``(n,)``.
    """

    topic: str
    kind: str
    content: Any
    logged_s: float | NDArray[np.float64]


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
    def messages(
        self,
        wanted: Choice,
        most_bytes: int = sys.maxsize,
        together: Callable[[str], bool] = lambda kind: False,
    ) -> Iterator[Message]:
        """Messages that are wanted and not larger, of definitions that are known; raises what its library raises.

        Those of types that may come ``together`` are gathered, each topic's in its order.
        """


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

    def messages(
        self,
        wanted: Choice,
        most_bytes: int = sys.maxsize,
        together: Callable[[str], bool] = lambda kind: False,
    ) -> Iterator[Message]:
        """See :class:`Bag`."""
        bag, unknown, failure = self._bag, set(), None
        waiting: dict[str, tuple[str, list[tuple[bytes, float]]]] = {}
        connections = [c for c in bag.connections if wanted(c.topic, c.msgtype)]
        try:
            for connection, logged, raw in bag.messages(connections=connections) if connections else ():
                kind = connection.msgtype
                if kind in unknown or len(raw) > most_bytes:
                    continue
                if kind not in bag.typestore.fielddefs and not (
                    kind == _STATE and _register_state(bag.typestore, raw)
                ):
                    unknown.add(kind)
                    continue
                if not together(kind):
                    yield Message(connection.topic, kind, bag.deserialize(raw, kind), 1e-9 * logged)
                    continue
                _, run = waiting.setdefault(connection.topic, (kind, []))
                if run and (len(run) == _LONGEST_RUN or len(raw) != len(run[0][0])):
                    yield from self._decode_run(connection.topic, kind, run)
                    run.clear()
                run.append((raw, 1e-9 * logged))
        except Exception as error:  # noqa: BLE001  (of a damaged end: what came before it is read)
            failure = error
        for topic, (kind, run) in waiting.items():
            yield from self._decode_run(topic, kind, run)
        if failure is not None:
            raise failure

    def _decode_run(self, topic: str, kind: str, run: list[tuple[bytes, float]]) -> Iterator[Message]:
        """Messages of one length, as many together as differ in their numbers alone."""
        rows = np.frombuffer(b"".join(raw for raw, _ in run), dtype=np.uint8).reshape(len(run), -1)
        logged, k = np.array([time for _, time in run]), 0
        while k < len(run):
            try:
                # The first says which bytes are no numbers.
                fixed = _AlikeMessages(self._bag, rows[k : k + 1]).read(kind)[1]
                n = int(np.argmin(np.append((rows[k:, fixed] == rows[k, fixed]).all(axis=1), False)))
                yield Message(
                    topic, kind, _AlikeMessages(self._bag, rows[k : k + n]).read(kind)[0], logged[k : k + n]
                )
            except (KeyError, IndexError, ValueError):
                n = 1
                yield Message(topic, kind, self._bag.deserialize(run[k][0], kind), logged[k])
            k += n


class _AlikeMessages:
    """Reads messages by the structure of the first: texts and lengths of lists, where numbers begin.

    Args:
        bag: that knows the definitions; ROS 2 aligns numbers to their size, from the fifth byte on.
        rows: ``(n, n_bytes)``.
    """

    def __init__(self, bag: Any, rows: NDArray[np.uint8]) -> None:
        self._types, self._aligned, self._rows = bag.typestore.fielddefs, bool(bag.is2), rows
        self._first, self._at = rows[0].tobytes(), 4 if bag.is2 else 0
        self._fixed = np.ones(rows.shape[1], dtype=np.bool_)
        if self._aligned and self._first[1] != 1:
            raise ValueError("its numbers begin with their highest byte")

    def read(self, kind: str) -> tuple[Any, NDArray[np.bool_]]:
        """Their fields, and which bytes are no numbers; raises KeyError, IndexError or ValueError of other types."""
        found = self._read_fields(kind)
        if not self._at <= len(self._first) < self._at + 8:
            raise ValueError("its definition is another one")
        self._fixed[self._at :] = False
        return found, self._fixed

    def _read_fields(self, kind: str) -> SimpleNamespace:
        return SimpleNamespace(**{name: self._read_field(*told) for name, told in self._types[kind][1]})

    def _read_field(self, node: Any, told: Any) -> Any:
        if node.name == "BASE":
            return self._read_text() if told[0] == "string" else self._read_numbers(told[0], 1)[0]
        if node.name == "NAME":
            return self._read_fields(told)
        inner, many = told if node.name == "ARRAY" else (told[0], self._read_count())
        if inner[0].name == "BASE" and inner[1][0] != "string":
            return self._read_numbers(inner[1][0], many)
        if many > len(self._first):
            raise ValueError("holds more entries than bytes")
        return [self._read_field(*inner) for _ in range(many)]

    def _read_numbers(self, word: str, many: int) -> NDArray[np.float64]:
        kind = np.dtype(
            {"bool": "u1", "byte": "u1", "char": "u1", "octet": "u1"}.get(word, word)
        ).newbyteorder("<")
        cut = self._take(kind.itemsize, many)
        self._fixed[cut] = False
        return np.ascontiguousarray(self._rows[:, cut]).view(kind).T.astype(np.float64)

    def _read_text(self) -> str:
        text: bytes = self._first[self._take(1, self._read_count())]
        return text.rstrip(b"\0").decode()

    def _read_count(self) -> int:
        return int.from_bytes(self._first[self._take(4, 1)], "little")

    def _take(self, size: int, many: int) -> slice:
        """The next bytes; what fills up before them may be anything."""
        start = self._at + (-(self._at - 4) % size if self._aligned and many else 0)
        self._fixed[self._at : start] = False
        self._at = start + size * many
        if self._at > len(self._first):
            raise ValueError("ends within its fields")
        return slice(start, self._at)


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

    def messages(
        self,
        wanted: Choice,
        most_bytes: int = sys.maxsize,
        together: Callable[[str], bool] = lambda kind: False,
    ) -> Iterator[Message]:
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
