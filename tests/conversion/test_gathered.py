"""Topics of a long recording share a bound: what is kept are means of rows, and nothing of it is lost."""

from __future__ import annotations

import numpy as np

from excite.conversion.sources.messages import Field, Gathered, Room

FIELDS = tuple(Field(f"position.{joint}", "q", joint) for joint in "abc")


def test_topics_stay_within_their_room_together_and_keep_means() -> None:
    room = Room(20_000)
    long, short = Gathered("long", room), Gathered("short", room)
    n = 30_000
    time = np.arange(n) * 1e-3
    values = np.column_stack([np.sin(time), np.cos(time), time])
    for k in range(n):
        long.add(time[k], FIELDS, values[k].tolist())
        if k % 100 == 0:
            short.add(time[k], FIELDS[:1], [time[k]])
    assert long.size + short.size <= 20_000
    kept, whole = long.stream(0.0), short.stream(0.0)
    assert kept is not None and whole is not None and kept.time is not None
    assert "means of 8," in long.note and short.note == ""
    assert whole.n_rows == 300
    # Each row is the mean of the eight that it stands for.
    rows = kept.n_rows
    expected = values[: 8 * rows].reshape(rows, 8, 3).mean(axis=1)
    np.testing.assert_allclose(np.column_stack([c.values for c in kept.columns]), expected, atol=1e-12)
    np.testing.assert_allclose(kept.time, time[: 8 * rows].reshape(rows, 8).mean(axis=1), atol=1e-12)
    assert rows > n // 8 - 2


def test_fields_that_come_later_are_missing_before() -> None:
    gathered = Gathered("topic", Room())
    for k in range(2000):
        fields = FIELDS if k >= 1500 else FIELDS[1::-1]
        gathered.add(float(k), fields, [float(k)] * len(fields))
    stream = gathered.stream(0.0)
    assert stream is not None
    columns = {column.label: column.values for column in stream.columns}
    assert (columns["a"] == np.arange(2000)).all() and np.isnan(columns["c"][:1500]).all()
    assert (columns["c"][1500:] == np.arange(1500, 2000)).all()
