"""The model of the gap: what it names beside each other, and that its shares add up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
from scipy.signal import lfilter

from excite.diagnosis.answer.gap import Budget, ChannelBudget, EffectShare, Named, UnnamedShare
from excite.diagnosis.arm.diagnose import find_changed_sizes, find_joints_in_unison, independent_joints
from excite.diagnosis.arm.read import is_gap_explained
from excite.diagnosis.budget.fit.joint_fit import effective_share
from excite.diagnosis.budget.made import budget_of, is_significant
from excite.diagnosis.budget.record import GapModel, fit_initial_baseline
from excite.diagnosis.budget.shares import Shares
from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.selection.found import build_gap_model
from excite.errors import LogError
from excite.logs.files import load_log, save_log
from excite.logs.log import Log, Trial
from excite.logs.robot import nominal_robot
from tests.diagnosis.test_one_joint import URDF as AXIS
from tests.diagnosis.test_one_joint import axis_header
from tests.diagnosis.two_joints import COULOMB, RATE_HZ, URDF, VISCOUS, moved, two_joint_log
from tests.reproduction import airbot_play_load, emps

FRICTION = ("rigid_body", "viscous_friction", "coulomb_friction")
More = Callable[[np.ndarray, np.ndarray], np.ndarray]


def searched(log: Log, modelled: tuple[str, ...]) -> GapModel:
    """The model of the gap of a log's own rows."""
    samples = arm_samples(nominal_robot(log), log, log.trials)
    floor = spectral_floor(samples)
    full = fit_initial_baseline(samples, modelled, floor)
    return build_gap_model(full, modelled, tuple(EFFECTS.values()), floor, None, np.random.default_rng(0))


def budgeted(log: Log, modelled: tuple[str, ...]) -> Budget:
    """The budget of a log's own rows."""
    found = searched(log, modelled)
    samples = found.baseline.samples
    tau = samples.to_rows([t.tau for t in samples.trials])[samples.identification_rows]
    return budget_of(found, spectral_floor(samples), tau.std(axis=0))


def two_joints(folder: Path, more: More | None = None) -> Log:
    """A record of two joints, with torques by position and velocity beside those of the model."""
    rng = np.random.default_rng(3)
    trials = [
        moved(n, role, s, rng, np.eye(2))
        for n, role, s in (("a", "identification", 25.0), ("b", "validation", 10.0))
    ]
    made = []
    for trial in trials:
        assert trial.tau is not None
        v = np.gradient(trial.q, trial.time, axis=0)
        added = np.zeros_like(trial.tau) if more is None else more(trial.q, v)
        made.append(
            Trial(name=trial.name, role=trial.role, time=trial.time, q=trial.q, tau=trial.tau + added)
        )
    return load_log(save_log(two_joint_log(tuple(made)), folder))


def bias_and_stribeck(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    slow = 0.8 * np.exp(-((v[:, 0] / 0.3) ** 2)) * np.sign(v[:, 0])
    return np.column_stack([slow, np.full(len(q), 0.4)])


def names(budget: Budget, joint: str) -> set[str]:
    return {item.effect for item in budget.named if item.location == joint}


def test_nothing_is_named_on_a_robot_that_is_its_model(tmp_path: Path) -> None:
    assert budgeted(two_joints(tmp_path), FRICTION).named == ()


def test_two_effects_are_both_named_with_the_sizes_of_the_joint_fit(tmp_path: Path) -> None:
    budget = budgeted(two_joints(tmp_path, bias_and_stribeck), FRICTION)
    assert {(item.effect, item.location) for item in budget.named} == {
        ("stribeck", "first"),
        ("torque_bias", "second"),
    }
    values = {item.effect: item.values for item in budget.named}
    bias, spread = values["torque_bias"]["bias"]
    assert spread is not None
    assert bias == pytest.approx(0.4, abs=max(4.0 * spread, 0.04))
    assert values["stribeck"]["velocity"][0] == pytest.approx(0.3, rel=0.3)
    assert all(item.probability > 0.9 for item in budget.named if not item.rivals)


def test_an_effect_at_one_joint_does_not_change_the_names_at_another(tmp_path: Path) -> None:
    def both(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return bias_and_stribeck(q, v) + np.column_stack([0.5 * np.cos(12.0 * q[:, 0]), np.zeros(len(q))])

    plain = budgeted(two_joints(tmp_path / "plain", bias_and_stribeck), FRICTION)
    more = budgeted(two_joints(tmp_path / "more", both), FRICTION)
    assert names(plain, "second") == names(more, "second") == {"torque_bias"}
    assert "torque_ripple" in names(more, "first")


def test_a_load_is_one_body_at_its_link(tmp_path: Path) -> None:
    """Half a kilogram at the tip: no first moments at one link and a mass at another, no factor beside it."""
    model = pin.buildModelFromXML(URDF)
    model.inertias[2] += pin.Inertia(0.5, np.array([0.25, 0.0, 0.05]), 1e-4 * np.eye(3))
    bare, data = pin.buildModelFromXML(URDF), model.createData()

    def load(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        a = np.gradient(v, 1.0 / RATE_HZ, axis=0)
        rows = list(zip(q, v, a, strict=True))
        without = np.array([pin.rnea(bare, data, *row) for row in rows])
        return np.array([pin.rnea(model, data, *row) for row in rows]) - without

    budget = budgeted(two_joints(tmp_path, load), ("rigid_body_fixed", *FRICTION[1:]))
    found, *others = budget.named
    assert (found.effect, found.location) == ("payload", "lower")
    assert found.values["mass"][0] == pytest.approx(0.5, rel=0.03)
    assert found.share > 0.95
    assert all(abs(item.share) < 0.02 for item in others)


@pytest.mark.parametrize("modelled", [("rigid_body",), FRICTION])
def test_shares_of_every_channel_add_up_to_one(tmp_path: Path, modelled: tuple[str, ...]) -> None:
    budget = budgeted(two_joints(tmp_path, bias_and_stribeck), modelled)
    for channel in budget.channels.values():
        shares = [item.share for item in (*channel.effects, *channel.unnamed)]
        assert sum(shares) + channel.rest == pytest.approx(1.0)
        assert all(low <= item.share <= high for item in channel.effects for low, high in [item.interval90])


@pytest.mark.battery
def test_many_effects_at_once_are_named(gap_dir: Path) -> None:
    """A lag, friction that grows with the load, offsets and bristles on seven joints; shares as the simulator's."""
    together = diagnose(gap_dir / "many" / "case_006")
    assert together.verdict == "effect"
    found = {(item.effect, item.location) for item in together.effects}
    assert {("load_dependent_friction", "arm_6_joint"), ("torque_bias", "arm_7_joint")} <= found
    assert all(item["probability"] >= 0.5 for item in together.to_json()["effects"])
    assert together.gap.after < together.gap.before
    assert together.budget is not None
    shares = {(item.effect, item.location): item.share for item in together.budget.named}
    assert shares["load_dependent_friction", "arm_6_joint"] == pytest.approx(0.258, abs=0.1)
    assert shares["torque_bias", "arm_7_joint"] == pytest.approx(0.241, abs=0.1)


def test_friction_that_is_not_modelled_is_named_at_every_joint(tmp_path: Path) -> None:
    """Neither term passes without the other: they are judged together and pruned."""
    budget = budgeted(two_joints(tmp_path), ("rigid_body",))
    found = {(item.effect, item.location): item.values for item in budget.named}
    for j, joint in enumerate(("first", "second")):
        assert found["coulomb_friction", joint]["level"][0] == pytest.approx(COULOMB[j], rel=0.1)
        assert found["viscous_friction", joint]["coefficient"][0] == pytest.approx(VISCOUS[j], rel=0.1)
    assert len(found) == 4


def test_what_has_no_name_is_said_with_what_it_follows(tmp_path: Path) -> None:
    """A torque that follows another joint's position is in no library."""

    def strange(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.column_stack([np.zeros(len(q)), 1.5 * np.abs(q[:, 0])])

    channel = budgeted(two_joints(tmp_path, strange), FRICTION).channels["second"]
    named = sum(item.share for item in channel.effects)
    assert max(channel.unnamed, key=lambda item: item.share).follows == "first"
    assert channel.unnamed[0].share > 0.5 > named


def test_both_frictions_of_a_ball_screw_are_named_with_their_published_sizes(
    data_dir: Path, tmp_path: Path
) -> None:
    budget = budgeted(emps.emps_log(data_dir, tmp_path, 0.67), ("rigid_body",))
    values = {item.effect: item.values for item in budget.named}
    coulomb, spread = values["coulomb_friction"]["level"]
    viscous, spread_v = values["viscous_friction"]["coefficient"]
    assert spread is not None
    assert spread_v is not None
    assert abs(coulomb - 20.39) < 1.9 * spread
    assert abs(viscous - 203.5) < 1.9 * spread_v


def test_a_log_that_says_nothing_of_friction_has_the_baseline_of_an_identification(tmp_path: Path) -> None:
    """Hand-written logs leave ``modelled`` out: friction is then no effect, as it is none for ``identify``."""
    folder = save_log(two_joint_log(two_joints(tmp_path / "plain").trials), tmp_path / "log")
    header = yaml.safe_load((folder / "log.yaml").read_text())
    del header["modelled"]
    (folder / "log.yaml").write_text(yaml.safe_dump(header))
    result = diagnose(folder)
    assert result.verdict == "none"
    assert result.effects == ()


def test_a_log_may_name_a_bundled_robot(tmp_path: Path) -> None:
    folder = save_log(two_joints(tmp_path / "plain"), tmp_path / "log")
    header = yaml.safe_load((folder / "log.yaml").read_text())
    (folder / "log.yaml").write_text(yaml.safe_dump(header | {"robot": "ur10"}))
    with pytest.raises(LogError, match="has no joint 'first'"):
        diagnose(folder)


@pytest.mark.parametrize(("judged", "said"), [(0.4, []), (1.2, ["other_machine"])])
def test_trials_of_another_machine_are_said_to_be(tmp_path: Path, judged: float, said: list[str]) -> None:
    """The same constant in all trials is one machine; another one in those that judge is not."""
    log = two_joints(tmp_path / "plain")
    sizes = {"identification": 0.4, "validation": judged}
    trials = tuple(replace(t, tau=t.tau + np.array([0.0, sizes[t.role]])) for t in log.trials)
    found = searched(load_log(save_log(two_joint_log(trials), tmp_path / "log")), FRICTION)
    assert [item.kind for item in find_changed_sizes(found.model)] == said


def test_a_size_of_next_to_nothing_is_no_other_machine(tmp_path: Path) -> None:
    """It is another by half of itself, surely, and closes nothing of the trials that judge: it has no name."""
    rng, sizes = np.random.default_rng(6), {"identification": 0.03, "validation": 0.015}
    plain = [moved(f"run_{role}", role, 150.0, rng, np.eye(2)) for role in sizes]
    trials = tuple(replace(t, tau=t.tau + np.array([0.0, sizes[t.role]])) for t in plain)
    found = searched(load_log(save_log(two_joint_log(trials), tmp_path / "log")), FRICTION)
    assert ("torque_bias", "second") not in {term.key for term in found.model.terms}
    assert find_changed_sizes(found.model) == ()


@pytest.mark.parametrize(
    ("shares", "unnamed", "said"),
    [
        ((0.6,), 0.0, True),  # most of it
        ((0.46,), 0.1, True),  # the largest share, and most of what follows anything
        ((0.4,), 0.1, False),  # what follows nothing is larger, at its own place too
        ((0.25, 0.2), 0.1, False),
        ((0.3,), 0.42, False),  # what has no name is larger
    ],
)
def test_effects_are_the_gap_where_the_largest_share_is_theirs(shares, unnamed, said) -> None:
    named = tuple(Named("stribeck", f"joint_{k}", share, 1.0, {}, 50.0) for k, share in enumerate(shares))
    at = tuple(EffectShare(item.effect, item.location, item.share, (0.15, 0.7)) for item in named)
    strange = (UnnamedShare("position", unnamed),)
    budget = Budget(
        {"joint_0": ChannelBudget(0.01, 1.0, at, strange, 1.0 - sum(shares) - unnamed, 1.0)}, named
    )
    assert is_gap_explained(budget, named) is said


def test_what_takes_most_of_its_own_place_is_the_gap_though_others_have_more_that_follows_nothing() -> None:
    """A joint's friction by its load, and three joints that nothing explains: the joint's is what has structure."""
    named = (Named("load_dependent_friction", "second", 0.2, 1.0, {}, 40.0),)
    at = (EffectShare("load_dependent_friction", "second", 0.51, (0.2, 0.8)),)
    channels = {
        "first": ChannelBudget(0.01, 1.0, (), (), 1.0, 0.6),
        "second": ChannelBudget(0.01, 1.0, at, (), 0.49, 0.4),
    }
    assert is_gap_explained(Budget(channels, named), named)


@pytest.mark.parametrize(("there", "said"), [(0.1, True), (0.6, False)])
def test_what_leads_its_own_place_is_the_gap_though_another_has_more_that_follows_something(
    there: float, said: bool
) -> None:
    """A first joint's gap follows its velocity; the second's effect is the gap if no more follows something there."""
    named = (Named("load_dependent_friction", "second", 0.3 * (0.9 - there), 1.0, {}, 40.0),)
    at = (EffectShare("load_dependent_friction", "second", 0.9 - there, (0.1, 0.95)),)
    channels = {
        "first": ChannelBudget(0.01, 1.0, (), (UnnamedShare("velocity", 0.5),), 0.5, 0.7),
        "second": ChannelBudget(0.01, 1.0, at, (UnnamedShare("load", there),), 0.1, 0.3),
    }
    assert is_gap_explained(Budget(channels, named), named) is said


def test_joints_that_move_on_one_path_are_counted_as_one() -> None:
    rng = np.random.default_rng(0)
    path, free = rng.normal(size=(500, 1)), rng.normal(size=(500, 4))
    assert independent_joints(path @ np.array([[1.0, -2.0, 0.1, 5.0]])) == pytest.approx(1.0, abs=1e-6)
    assert independent_joints(free) == pytest.approx(4.0, rel=0.05)


def test_of_an_arm_that_moves_in_unison_only_its_torque_scales_are_said(
    data_dir: Path, tmp_path: Path
) -> None:
    log = airbot_play_load.chirp_log(data_dir, tmp_path, loaded=False)
    samples = arm_samples(nominal_robot(log), log, log.trials)
    finding = find_joints_in_unison(
        fit_baseline(samples, ("rigid_body_fixed", *FRICTION[1:]), spectral_floor(samples))
    )
    assert finding is not None
    assert finding.figures["independent"] == pytest.approx(1.0, abs=0.1)
    assert finding.figures["torque_scale.joint4"] == pytest.approx(1.6, rel=0.1)
    assert finding.figures["torque_scale.joint5"] == pytest.approx(1.6, rel=0.1)


def test_of_an_arm_that_moves_in_unison_no_stop_is_told_either(data_dir: Path, tmp_path: Path) -> None:
    """On one path the weight that a model lacks looks like a stop that the fourth joint runs into."""
    log = airbot_play_load.chirp_log(data_dir, tmp_path, loaded=False)
    modelled = ("rigid_body_fixed", *FRICTION, "armature", "torque_bias")
    result = diagnose(replace(log, header=log.header.model_copy(update={"modelled": modelled})))
    assert result.verdict == "unknown" and "unison" in {finding.kind for finding in result.faults}
    assert " stop" not in result.summary()


def test_a_slow_rest_has_few_samples_that_count() -> None:
    """Of a rest of first order with the coefficient a, ``(1 − a)/(1 + a)`` of all."""
    rng, n, keep = np.random.default_rng(4), 20000, 0.9
    rest = lfilter([1.0], [1.0, -keep], rng.normal(size=n))
    share = effective_share(rest[None], np.ones(n, bool), np.zeros(n, np.int64))
    assert share[0] == pytest.approx((1.0 - keep) / (1.0 + keep), rel=0.25)


def test_both_frictions_left_out_are_named_and_no_rivals(data_dir: Path, tmp_path: Path) -> None:
    """Each alone takes most of the gap of a ball screw, and yet both are there."""
    log = emps.emps_log(data_dir, tmp_path, 0.67)
    log = replace(log, header=log.header.model_copy(update={"modelled": ("rigid_body", "torque_bias")}))
    result = diagnose(log)
    values = {item.effect: next(iter(item.parameters.values())) for item in result.effects}
    assert result.verdict == "effect" and set(values) == set(FRICTION[1:])
    for name, published in (("coulomb_friction", 20.39), ("viscous_friction", 203.5)):
        std = values[name].std
        assert std is not None and abs(values[name].value - published) < 1.9 * std


def test_play_before_friction_is_named_with_its_width(tmp_path: Path) -> None:
    """A damper moved back and forth: nothing resists for 4 mm after a reversal, then friction builds up over 1 mm."""
    rng, n = np.random.default_rng(7), 8000
    t = np.arange(n) / 1000.0

    def trial(name: str, role: str, size: float) -> Trial:
        q = size * np.sin(2.0 * np.pi * 0.7 * t) + 0.3 * size * np.sin(2.0 * np.pi * 1.9 * t)
        force, side, held, used = np.zeros(n), 0, 0.0, 0.0
        for i, way in enumerate(np.diff(q)):
            # A spring of 1 mm up to the level, and 4 mm of nothing where it lets go.
            if side == 0:
                used += way
                side = 1 if used > 2e-3 else -1 if used < -2e-3 else 0
                held = used - side * 2e-3 if side else 0.0
            else:
                held = float(np.clip(held + way, -1e-3, 1e-3))
                if held * side <= 0.0:
                    used, side, held = side * 2e-3 + held, 0, 0.0
            force[i + 1] = 5000.0 * held / 1e-3
        force += rng.normal(size=n)
        return Trial(name=name, role=role, time=t, q=q[:, None], tau=force[:, None])

    header = axis_header(1000, ("rigid_body_fixed",), ("long", "short"))
    trials = (trial("long", "identification", 0.02), trial("short", "validation", 0.015))
    urdf = AXIS.replace('"100"', '"1e-3"').replace('"1"', '"1e-6"')
    result = diagnose(load_log(save_log(Log(header, trials, robot_text=urdf), tmp_path / "damper")))
    found = {item.effect: item.parameters for item in result.effects}
    assert result.verdict == "effect" and set(found) == {"coulomb_friction", "backlash"}
    assert found["coulomb_friction"]["level"].value == pytest.approx(5000.0, rel=0.03)
    assert found["backlash"]["width"].value == pytest.approx(4e-3, rel=0.1)
    assert result.gap.share_closed > 0.97


def shares(value: list[float], lost: list[float]) -> Shares:
    """What one effect takes of two joints, known to a tenth."""
    row, tenth = np.array([value]), np.full((1, 2), 0.1)
    one = np.ones(2)
    return Shares(one, one, one, one, row, row - tenth, row + tenth, np.array([lost]), tenth)


def test_an_effect_that_shares_what_another_takes_is_not_clear() -> None:
    """Let in alone it takes a part of what the other one takes; without it next to nothing is lost."""
    assert is_significant(shares([0.5, 0.0], [0.9, 0.0]), 0)
    assert not is_significant(shares([0.5, 0.0], [0.001, 0.0]), 0)


def test_an_effect_is_clear_where_another_joint_has_the_gap_without_it() -> None:
    """A servo too weak at the last joint: without it the link is lighter, and the joints before have the gap."""
    assert is_significant(shares([0.0, 0.998], [721.0, 0.014]), 0)
    assert not is_significant(shares([0.0, 0.0], [0.09, 0.09]), 0)
