"""Which trials of several logs are of one session."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from excite.errors import LogError
from excite.logs.log import Log


def split_sessions(logs: Sequence[Log]) -> dict[str, Log]:
    """Logs by session: trials that name one go there, the rest of each log is a session of its own.

    Sessions of the same name in several logs are told apart by the logs' folders.

    Args:
        logs: as they were loaded.

    Returns:
        A log for each session, by its name.

    Raises:
        LogError: the logs hold fewer than two sessions.
    """
    sessions: dict[str, Log] = {}
    named = Counter(key for log in logs for key in {trial.session for trial in log.trials} if key)
    shared = {key for key, count in named.items() if count > 1}
    for number, log in enumerate(logs, start=1):
        own = log.folder.name if log.folder else f"log_{number}"
        keys = [trial.session or own for trial in log.trials]
        for key in dict.fromkeys(keys):
            name = f"{own}/{key}" if key in shared else key
            name = f"{name}_{number}" if name in sessions else name
            chosen = [i for i, other in enumerate(keys) if other == key]
            header = log.header.model_copy(update={"trials": tuple(log.header.trials[i] for i in chosen)})
            sessions[name] = replace(log, header=header, trials=tuple(log.trials[i] for i in chosen))
    if len(sessions) < 2:
        raise LogError(
            "holds one session",
            source=logs[0].folder if logs else None,
            field="trials",
            remedy="name sessions in log.yaml, or give several logs",
        )
    return sessions
