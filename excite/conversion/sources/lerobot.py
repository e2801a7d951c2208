"""LeRobot data sets, versions 2.1 and 3.0: ``meta/info.json`` and Parquet files of episodes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

from excite.conversion.recording import Column, Recording, Stream
from excite.conversion.sources.source import Source
from excite.errors import LogError
from excite.formats.lerobot import COUNTING, DataSet, is_data_set, read_data_set

# What each feature holds for a follower arm.
_CHANNELS = {
    "observation.state": "q",
    "action": "q_cmd",
    "observation.velocity": "v",
    "observation.effort": "tau",
}
# Names of a feature's numbers may say what each is: arms that report more than positions have it in one state
# (``joint_1.pos``, ``joint_1.vel``, ``joint_1.torque`` of OpenArm). Commands of velocities have no channel in a log.
_ENDINGS = {
    ".pos": {"q": "q", "q_cmd": "q_cmd"},
    ".vel": {"q": "v", "v": "v"},
    ".effort": {"q": "tau", "q_cmd": "tau_cmd", "tau": "tau"},
    ".torque": {"q": "tau", "q_cmd": "tau_cmd", "tau": "tau"},
    ".current": {"q": "i", "tau": "i"},
}


class LeRobotSource(Source):
    """Episodes as recordings; states are positions, actions their commands."""

    name: ClassVar[str] = "lerobot"
    summary: ClassVar[str] = "LeRobot data sets (folder with meta/info.json)"
    own_process: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        return is_data_set(path)

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        return tuple(recordings_of_episodes(read_data_set(path, LogError)))


def recordings_of_episodes(data: DataSet) -> Iterator[Recording]:
    """The episodes of a data set, one after the other."""
    fps = data.fps
    note = f"{fps:g} rows a second: inertia and friction of slow motion show, delays and rotors do not"
    said = {"fps": fps or None, "maybe_shares": True}
    for episode, arrays in data.episodes():
        name, time = f"episode_{episode:06d}", arrays.pop("time", None)
        columns = tuple(_feature_columns(data, arrays))
        streams = (Stream(name, columns, time),) if columns else ()
        yield Recording(str(data.path), name, streams, said, (note,) if fps else ())


def _feature_columns(data: DataSet, arrays: dict[str, Any]) -> list[Column]:
    found = []
    for name, values in arrays.items():
        if name in COUNTING:
            continue
        labels = data.names(name)
        values = values.reshape(len(values), -1)
        channel = _CHANNELS.get(name, "")
        for k in range(values.shape[1]):
            label = labels[k] if k < len(labels) else str(k)
            ending = next((word for word in _ENDINGS if label.endswith(word)), "")
            what = _ENDINGS[ending].get(channel, "") if ending else channel
            found.append(
                Column(f"{name}.{label}", values[:, k].astype(float), what, label.removesuffix(ending))
            )
    return found
