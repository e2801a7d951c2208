"""Which bodies a payload may be."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from excite.diagnosis.effects.bodies import Payload
from excite.regressor.kernels import joint_torque_regressor
from excite.robot.loading import load_robot


@pytest.mark.parametrize(
    ("share", "std", "may"), [(0.5, 0.01, True), (-0.8, 0.01, True), (-1.5, 0.01, False)]
)
def test_a_body_that_leaves_its_link_less_than_no_mass_cannot_be(share: float, std: float, may: bool) -> None:
    robot = load_robot("panda")
    phi = np.concatenate([inertia.toDynamicParameters() for inertia in list(robot.model.inertias)[1:]])
    context = SimpleNamespace(baseline=SimpleNamespace(phi=phi, samples=SimpleNamespace(robot=robot)))
    link = Payload().locations(context)[4]
    mass = robot.model.inertias[5].mass
    extra = share * mass * np.eye(10)[0]
    fit = SimpleNamespace(extra=extra, extra_std=np.full(10, std * mass))
    assert Payload().is_physical(context, link, fit) is may
    # Where the record hardly tells the mass, it may be anything.
    unsure = SimpleNamespace(extra=extra, extra_std=np.full(10, mass))
    assert Payload().is_physical(context, link, unsure)


@pytest.mark.parametrize(("modelled", "may"), [((), False), (("armature",), True)])
def test_a_body_without_weight_is_a_rotor_that_the_model_lacks(modelled: tuple[str, ...], may: bool) -> None:
    robot = load_robot("panda")
    rng = np.random.default_rng(0)
    motion = {name: rng.normal(size=(50, robot.n_joints)) for name in ("q", "v", "a")}
    samples = SimpleNamespace(
        robot=robot,
        rigid_regressor=lambda: joint_torque_regressor(robot.model, *motion.values()),
        motion_cache={},
    )
    context = SimpleNamespace(baseline=SimpleNamespace(modelled=modelled, samples=samples))
    link = Payload().locations(context)[1]
    flywheel = 0.5 * np.eye(10)[9]
    assert Payload().is_admissible(context, link, (), flywheel) is may
    assert Payload().is_admissible(context, link, (), flywheel + 0.5 * np.eye(10)[1])


def context_of(motion: dict[str, np.ndarray]) -> SimpleNamespace:
    robot = load_robot("panda")
    samples = SimpleNamespace(
        robot=robot,
        rigid_regressor=lambda: joint_torque_regressor(robot.model, *motion.values()),
        motion_cache={},
    )
    phi = np.concatenate([inertia.toDynamicParameters() for inertia in list(robot.model.inertias)[1:]])
    return SimpleNamespace(baseline=SimpleNamespace(modelled=(), phi=phi, samples=samples))


def moving(*still: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    motion = {name: rng.normal(size=(50, 7)) for name in ("q", "v", "a")}
    for name in ("v", "a"):
        motion[name][:, list(still)] = 0.0
    return motion


def ball(mass: float, x: float) -> np.ndarray:
    """A ball of 5 cm on the joint's x axis."""
    own = 0.4 * mass * 0.05**2
    return np.array([mass, mass * x, 0, 0, own, 0, own + mass * x**2, 0, 0, own + mass * x**2])


@pytest.mark.parametrize(
    ("body", "may"),
    [
        (ball(1.0, 0.2), True),
        (-ball(1.0, 0.2), True),
        # Heavier than the link that it is taken from; without a mass; out of reach; second moments below zero.
        (-ball(9.0, 0.2), False),
        (ball(1.0, 0.2) * (np.arange(10) != 0), False),
        (ball(1.0, 0.9), False),
        (ball(1.0, 0.2) - np.eye(10)[6] * 0.05, False),
    ],
)
def test_a_payload_is_a_body_that_can_exist(body: np.ndarray, may: bool) -> None:
    payload, context = Payload(), context_of(moving())
    assert payload.is_possible(context, payload.locations(context)[5], body) is may


def test_of_what_an_axis_does_not_tell_of_a_body_anything_will_do() -> None:
    """The first joint, which is upright, tells one moment of inertia of what it carries."""
    payload, context = Payload(), context_of(moving())
    first = payload.locations(context)[0]
    assert payload.is_possible(context, first, 0.5 * np.eye(10)[9])
    # More than the whole link has within reach cannot be taken from it.
    assert not payload.is_possible(context, first, -3.0 * np.eye(10)[9])


def test_a_mass_that_no_joint_tells_is_not_said() -> None:
    """What a record leaves as open as it was before is no value, nor is what rounding leaves of a column."""
    payload, context = Payload(), context_of(moving())
    sixth = payload.locations(context)[5]
    std = np.array([20.0, 0.01, 0.01, 0.01, *[0.1] * 6])
    fit = SimpleNamespace(extra=np.array([0.0, 0.3, 0.0, 0.4, *[0.0] * 6]), extra_std=std)
    shown = payload.to_estimates(context, sixth, (), fit)
    assert next(iter(shown)) == "first_moment"
    assert shown["first_moment"].value == pytest.approx(0.5)
    assert "mass" not in shown
    known = SimpleNamespace(extra=fit.extra, extra_std=std * (np.arange(10) > 0) + 0.1 * np.eye(10)[0])
    assert next(iter(payload.to_estimates(context, sixth, (), known))) == "mass"
