"""Couplings of constant ratios: solved at once as Newton's method solves them sample by sample."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.robot.mechanisms.closures import Coupling
from excite.robot.mechanisms.mechanism import ConstantRatios, Mechanism
from tests.robot.mechanisms.test_public_path import MIMIC, brought, shaped_four_bar
from tests.robot.small import ELBOW_LIMIT, spoiled

pytestmark = pytest.mark.usefixtures("readers_here")


@pytest.fixture(scope="module")
def finger(tmp_path_factory: pytest.TempPathFactory) -> Mechanism:
    """An elbow that follows the shoulder by a factor of -0.5, and 0.1 rad."""
    robot = brought(spoiled(ELBOW_LIMIT, ELBOW_LIMIT + MIMIC), tmp_path_factory.mktemp("finger"))
    assert robot.mechanism is not None
    return robot.mechanism


def _by_search(mechanism: Mechanism, monkeypatch: pytest.MonkeyPatch) -> Mechanism:
    monkeypatch.setattr(ConstantRatios, "from_closures", lambda *_: None)
    return replace(mechanism)


def test_all_samples_at_once_are_those_of_the_search(
    finger: Mechanism, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(0)
    q, v, a = (rng.uniform(-0.5, 0.5, (30, finger.model.nv)) for _ in range(3))
    assert finger.ratios is not None
    at_once, maps, open_by = finger.complete_motion(q, v, a), finger.motion_maps(q), finger.closure_gaps(q)
    np.testing.assert_allclose(finger.close_configurations(q), at_once.q)
    assert finger.closure_gaps(at_once.q).max() < 1e-12
    searched = _by_search(finger, monkeypatch)
    assert searched.ratios is None
    one_by_one = searched.complete_motion(q, v, a)
    for name in ("q", "v", "a"):
        np.testing.assert_allclose(getattr(at_once, name), getattr(one_by_one, name), atol=1e-9)
    np.testing.assert_allclose(maps, searched.motion_maps(q), atol=1e-12)
    np.testing.assert_allclose(open_by, searched.closure_gaps(q), atol=1e-12)
    np.testing.assert_allclose(finger.follow_driven(q, v, a).a, searched.follow_driven(q, v, a).a, atol=1e-12)


def test_loops_curves_and_loose_joints_are_searched_for(finger: Mechanism, tmp_path: Path) -> None:
    four_bar = brought(shaped_four_bar(), tmp_path).mechanism
    assert four_bar is not None and four_bar.ratios is None
    (coupling,) = finger.closures
    assert isinstance(coupling, Coupling)
    bent = replace(coupling, factors=tuple((*factors, 0.3) for factors in coupling.factors))
    assert replace(finger, closures=(bent,)).ratios is None
    own = [position for _, position in coupling.columns].index(int(finger.passive[0]))
    factors = tuple((0.0,) if k == own else one for k, one in enumerate(coupling.factors))
    assert replace(finger, closures=(replace(coupling, factors=factors),)).ratios is None
    assert replace(finger, closures=(coupling, coupling)).ratios is None
