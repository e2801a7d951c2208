"""LeRobot data sets, versions 2.1 and 3.0: ``meta/info.json`` and Parquet files of episodes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.conversion.recording import Column, Recording, Stream
from excite.conversion.sources.source import Source
from excite.errors import LogError
from excite.formats.arrow import read_arrow
from excite.formats.documents import read_json

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
        return (path / "meta" / "info.json").is_file()

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        info = read_json(path / "meta" / "info.json", error=LogError)
        files = sorted((path / "data").glob("**/*.parquet"))
        if not files:
            raise LogError(
                "has no Parquet files", source=path / "data", remedy="download the data set's data folder"
            )
        features = info.get("features", {})
        found: list[Recording] = []
        for file in files:
            found += _split_episodes(read_arrow(file, LogError), features, info, path)
        return tuple(found)


def _split_episodes(
    arrays: dict[str, Any], features: dict[str, Any], info: dict[str, Any], path: Path
) -> list[Recording]:
    n = max((len(values) for values in arrays.values()), default=0)
    index = arrays.get("episode_index", np.zeros(n)).astype(int)
    found = []
    fps = float(info.get("fps", 0.0))
    note = (
        f"{fps:g} rows a second: inertia and friction of slow motion show, delays and rotors do not"
        if fps
        else ""
    )
    for episode in np.unique(index):
        rows = index == episode
        frames = arrays.get("frame_index", np.arange(n))[rows]
        time = arrays["timestamp"][rows] if "timestamp" in arrays else frames / fps if fps else None
        columns = tuple(_feature_columns(arrays, features, rows))
        if columns:
            stream = Stream(f"episode_{episode:06d}", columns, time)
            found.append(
                Recording(
                    str(path),
                    f"episode_{episode:06d}",
                    (stream,),
                    {"fps": fps or None, "maybe_shares": True},
                    (note,) if note else (),
                )
            )
    return found


def _feature_columns(arrays: dict[str, Any], features: dict[str, Any], rows: Any) -> list[Column]:
    found = []
    for name, values in arrays.items():
        if name in {
            "timestamp",
            "frame_index",
            "episode_index",
            "index",
            "task_index",
            "next.done",
            "next.reward",
        }:
            continue
        labels = _feature_names(features.get(name, {}))
        values = values.reshape(len(values), -1)
        channel = _CHANNELS.get(name, "")
        for k in range(values.shape[1]):
            label = labels[k] if k < len(labels) else str(k)
            ending = next((word for word in _ENDINGS if label.endswith(word)), "")
            what = _ENDINGS[ending].get(channel, "") if ending else channel
            numbers = values[rows, k].astype(float)
            found.append(Column(f"{name}.{label}", numbers, what, label.removesuffix(ending)))
    return found


def _feature_names(feature: dict[str, Any]) -> list[str]:
    return _flatten_names(feature.get("names") or [])


def _flatten_names(names: Any) -> list[str]:
    """Names in a list, or in lists or dictionaries of lists, one a motor."""
    if isinstance(names, dict):
        return [name for inner in names.values() for name in _flatten_names(inner)]
    if isinstance(names, list):
        return [name for inner in names for name in _flatten_names(inner)]
    return [str(names)]
