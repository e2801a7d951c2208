"""A virtual person, recorded once."""

from __future__ import annotations

from dataclasses import dataclass

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
