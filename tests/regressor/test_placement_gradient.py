"""The derivative with a joint's position against difference quotients of pinocchio's inverse dynamics."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from excite.errors import InputError
from excite.regressor.kernels import placement_gradient
from tests.regressor.conftest import Sampled, odd_tree, sample


def _quotient(s: Sampled, joint: int, step: float = 1e-2) -> np.ndarray:
    """Central differences, exact for torques that are of second degree in the position."""
    columns = []
    for axis in np.eye(3):
        both = []
        for sign in (1.0, -1.0):
            model = s.model.copy()
            placement = model.jointPlacements[joint].copy()
            placement.translation = placement.translation + sign * step * axis
            model.jointPlacements[joint] = placement
            data = model.createData()
            both.append(np.array([pin.rnea(model, data, *each) for each in zip(s.q, s.v, s.a, strict=True)]))
        columns.append((both[0] - both[1]) / (2.0 * step))
    return np.stack(columns, axis=2)


def test_it_is_the_difference_quotient_at_every_joint(sampled: Sampled) -> None:
    few = Sampled(sampled.model, sampled.q[:18], sampled.v[:18], sampled.a[:18])
    first = 2 if sampled.model.joints[1].shortname() == "JointModelFreeFlyer" else 1
    for joint in range(first, sampled.model.njoints):
        found = placement_gradient(few.model, few.model.names[joint], few.q, few.v, few.a)
        truth = _quotient(few, joint)
        # Zero but for the rounding of torques of some hundred newton metres is zero.
        assert np.abs(found - truth).max() <= 1e-9 * np.abs(truth).max() + 1e-12


def test_it_follows_other_parameters_than_the_models_own() -> None:
    s = sample(odd_tree(root=False), 5)
    phi = np.concatenate([inertia.toDynamicParameters() for inertia in list(s.model.inertias)[1:]])
    at = placement_gradient(s.model, "joint3", s.q, s.v, s.a, 2.0 * phi)
    np.testing.assert_allclose(at, 2.0 * placement_gradient(s.model, "joint3", s.q, s.v, s.a), rtol=1e-12)


@pytest.mark.parametrize("joint", ["elbow", "root", "universe"])
def test_a_joint_that_cannot_be_moved_is_refused(joint: str) -> None:
    s = sample(odd_tree(root=True), 2)
    with pytest.raises(InputError, match=joint):
        placement_gradient(s.model, joint, s.q, s.v, s.a)
