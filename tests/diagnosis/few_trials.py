"""A log of fewer trials, for tests whose sentence does not need all of them."""

from __future__ import annotations

from dataclasses import replace

from excite.logs.log import Log


def few_trials(log: Log, learn: int = 2, judge: int = 1) -> Log:
    """The log's first trials to learn from, and its first to judge by."""
    kept = (*log.role("identification")[:learn], *log.role("validation")[:judge])
    pairs = [pair for pair in zip(log.header.trials, log.trials, strict=True) if pair[1] in kept]
    header = log.header.model_copy(update={"trials": tuple(entry for entry, _ in pairs)})
    return replace(log, header=header, trials=tuple(trial for _, trial in pairs))
