"""A virtual person, recorded once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from excite.human.recording import Recording
from tests.human.virtual_subject import Performance, VirtualSubject, draw_subject, perform, record, standing


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
    show = perform(who, 5.0, seed=2)
    return Session(who, show, record(who, show, rng, noise=0.5), standing(who, rng, noise=0.5))
