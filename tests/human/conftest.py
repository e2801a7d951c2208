"""A virtual person, recorded once."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from benchmarks.virtual_person import (
    Performance,
    VirtualSubject,
    draw_subject,
    perform_exercise,
    record_performance,
    record_standing,
)
from excite.human import measure
from excite.human.measure import MeasuredPerson, measure_recordings
from excite.human.recording import Recording


@dataclass(frozen=True, eq=False)
class Session:
    """Truth and recordings."""

    who: VirtualSubject
    show: Performance
    trial: Recording
    static: Recording


@pytest.fixture(scope="session")
def session() -> Session:
    """Five seconds of motion with half of the usual noise, and standing."""
    rng = np.random.default_rng(5)
    who = draw_subject(rng)
    show = perform_exercise(who.body, 5.0, seed=2)
    return Session(
        who, show, record_performance(who, show, rng, noise=0.5), record_standing(who, rng, noise=0.5)
    )


@pytest.fixture(scope="session")
def person(session: Session) -> MeasuredPerson:
    """The virtual person as measured from that."""
    return measure_recordings(session.who.body.subject, [session.trial], [session.static])


@pytest.fixture(scope="module")
def solved_once() -> Iterator[None]:
    """The body and the postures of the same markers are solved for once, whatever the plates beside them say."""

    def remembered(solve: Callable[..., Any]) -> Callable[..., Any]:
        known: dict[bytes, Any] = {}

        def solved(*given: object) -> Any:
            markers = (replace(x, plates=()) if isinstance(x, Recording) else x for x in given)
            key = pickle.dumps(tuple(markers))
            if key not in known:
                known[key] = solve(*given)
            return known[key]

        return solved

    with pytest.MonkeyPatch.context() as patch:
        for name in ("calibrate_body", "trial_poses"):
            patch.setattr(measure, name, remembered(getattr(measure, name)))
        yield
