"""Where a rest is more than noise, and where trials disagree by more than noise."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from excite.diagnosis.attribution import structured_joints

JOINTS = ("a", "b", "c", "d")
N, SPECTRAL = 2000, np.full(4, 0.01)


def found(rest: dict[int, float], floor: dict[int, float], scale: float = 1.0) -> tuple[str, ...]:
    """Joints called structured, where some have more than noise as a rest, or as a floor of repeats [N·m]."""
    sizes, floors = SPECTRAL.copy(), SPECTRAL.copy()
    sizes[list(rest)], floors[list(floor)] = list(rest.values()), list(floor.values())
    residual = sizes[:, None] * np.random.default_rng(0).normal(size=(4, N))
    samples = SimpleNamespace(
        identification_rows=np.ones(N, bool), trial_of_row=np.repeat(np.arange(4), N // 4), joints=JOINTS
    )
    attribution = SimpleNamespace(
        final=SimpleNamespace(
            samples=samples, judging_residual=lambda values: values, fit=SimpleNamespace(residual=residual)
        ),
        floor=floors,
        scale=np.full(4, scale),
    )
    return structured_joints(attribution, SPECTRAL)


def test_noise_is_not_structured():
    assert found({}, {}) == ()


def test_a_rest_above_the_floor_is_most_first():
    assert found({1: 0.04, 3: 0.08}, {}) == ("d", "b")


def test_a_rest_too_small_to_matter_is_no_gap():
    assert found({1: 0.018}, {}, scale=10.0) == ()


def test_what_does_not_repeat_at_one_joint_is_a_gap():
    """A floor of repeated trials rises with what is different in every trial."""
    assert found({2: 0.05}, {2: 0.05}) == ("c",)
    # All joints alike: the record is noisier than its spectrum above the band says.
    everywhere = dict.fromkeys(range(4), 0.05)
    assert found(everywhere, everywhere) == ()


def test_where_it_is_much_of_the_torque_less_above_the_noise_will_do():
    assert found({2: 0.02}, {2: 0.02}) == ()
    assert found({2: 0.02}, {2: 0.02}, scale=0.3) == ("c",)
