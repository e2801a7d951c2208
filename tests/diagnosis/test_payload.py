"""Which bodies a payload may be."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from excite.diagnosis.effects.bodies.payload import Payload
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
    assert Payload().physical(context, link, fit) is may
    # Where the record hardly tells the mass, it may be anything.
    unsure = SimpleNamespace(extra=extra, extra_std=np.full(10, mass))
    assert Payload().physical(context, link, unsure)


@pytest.mark.parametrize(("modelled", "may"), [((), False), (("armature",), True)])
def test_a_body_without_weight_is_a_rotor_that_the_model_lacks(modelled: tuple[str, ...], may: bool) -> None:
    robot = load_robot("panda")
    rng = np.random.default_rng(0)
    motion = {name: rng.normal(size=(50, robot.n_joints)) for name in ("q", "v", "a")}
    samples = SimpleNamespace(robot=robot, stacked=motion.get, of_joints=lambda values: values, kept={})
    context = SimpleNamespace(baseline=SimpleNamespace(modelled=modelled, samples=samples))
    link = Payload().locations(context)[1]
    flywheel = 0.5 * np.eye(10)[9]
    assert Payload().admissible(context, link, (), flywheel) is may
    assert Payload().admissible(context, link, (), flywheel + 0.5 * np.eye(10)[1])
