"""A diagnosis on a terminal: everything accepted is in the table, and what is wrong with all trials is said once."""

from __future__ import annotations

from dataclasses import replace

import pytest

from excite.diagnosis.answer.answer import NO_NAME, Diagnosis
from excite.diagnosis.answer.candidate import Candidate, Estimate, describe_with_size
from excite.diagnosis.answer.gap import Budget, ChannelBudget, ChannelGap, EffectShare, Gap, Named
from excite.finding import Finding


def candidate(effect: str, place: str, evidence: float) -> Candidate:
    return Candidate(
        effect, place, {"periods_per_rev": Estimate(13.0, None, "1")}, evidence, 0.1, 0.9, (place,)
    )


@pytest.fixture
def two_effects() -> Diagnosis:
    spring, rival = candidate("joint_spring", "a", 900.0), candidate("torque_ripple", "a", 12.0)
    jitter = Finding("jitter", "stamps jitter by 13 %", {}, ("time",), repaired=True, remedy="believed")
    clipped = Finding(
        "clipped", "tau.a clips in 3 rows", {}, ("tau.a",), severity="limits", remedy="carry less"
    )
    gap = Gap(0.2, 0.05, 0.04, 0.98, {"a": ChannelGap(2.0, 0.5, 0.4, "N·m")})
    effects = (spring, candidate("stribeck", "b", 400.0))
    return Diagnosis(
        "arm",
        "effect",
        "joint_spring",
        "a",
        ("a",),
        (spring, rival),
        effects,
        gap,
        (),
        faults=(jitter, clipped),
    )


def table(diagnosis: Diagnosis) -> dict[tuple[str, str], str]:
    """Standing by effect and place, as printed."""
    names = {(c.effect, c.location or "") for c in (*diagnosis.candidates, *diagnosis.effects)}
    rows = [line.split() for line in diagnosis.summary().splitlines()]
    return {(r[0], r[1]): " ".join(r[2:4]) for r in rows if len(r) > 3 and (r[0], r[1]) in names}


def test_every_accepted_effect_is_in_the_table(two_effects: Diagnosis):
    found = table(two_effects)
    assert found["joint_spring", "a"].startswith("accepted")
    assert found["stribeck", "b"].startswith("accepted")
    assert found["torque_ripple", "a"].startswith("tried")


def test_what_cannot_be_told_apart_stands_alike(two_effects: Diagnosis):
    found = table(replace(two_effects, verdict="ambiguous", n_tied=2))
    assert found["joint_spring", "a"] == found["torque_ripple", "a"] == "as likely"


def test_effects_beside_those_that_cannot_be_told_apart_are_in_the_sentence(two_effects: Diagnosis):
    """What is sure comes first; the share closed is that of all."""
    said = replace(two_effects, verdict="ambiguous", n_tied=2).sentence()
    sure, either = said.index("stribeck at b"), said.index("joint spring at a")
    assert sure < either < said.index("torque ripple at a") < said.index("which of these; adding all closes")
    alone = replace(two_effects, verdict="ambiguous", n_tied=2, effects=two_effects.effects[:1]).sentence()
    assert "stribeck" not in alone and "cannot say which; adding one closes" in alone


def test_what_an_unknown_gap_is_like_comes_first_and_once(two_effects: Diagnosis):
    like = f"the gap at b is that of a stop (edge 0.75 rad); {NO_NAME}"
    unknown = replace(two_effects, verdict="unknown", effect=None, location="b", candidates=(), effects=())
    found = replace(unknown, warnings=("record longer", like)).summary()
    assert like in found.splitlines()[0]
    assert found.count(like) == 1 and "note: record longer" in found
    assert "no effect in the library explains" in unknown.summary().splitlines()[0]


def test_what_is_clear_beside_an_unknown_gap_is_said_with_it(two_effects: Diagnosis):
    sentence = replace(two_effects, verdict="unknown", effect=None, location="c").sentence()
    clear, left = sentence.split("; ")
    assert "joint spring at a" in clear and "stribeck at b" in clear
    assert "are clear at their own place, and adding them closes" in clear
    assert left.startswith("there is a gap at c that no effect in the library explains")
    alone = replace(two_effects, verdict="unknown", location="c", effects=two_effects.effects[:1]).sentence()
    assert "is clear at its own place, and adding it closes" in alone


def test_what_the_doctor_found_is_said_once(two_effects: Diagnosis):
    lines = [line for line in two_effects.summary().splitlines() if line.startswith("log:")]
    assert lines == [
        "log: stamps jitter by 13 % (believed; repaired)",
        "log: tau.a clips in 3 rows (carry less)",
    ]
    # The limits of what is said hold it too, as it limits.
    limited = replace(two_effects, warnings=("tau.a clips in 3 rows", "a gap is left at a"))
    assert [line for line in limited.summary().splitlines() if line.startswith("note:")] == [
        "note: a gap is left at a"
    ]
    assert limited.summary().count("tau.a clips in 3 rows") == 1


def test_shares_that_differ_are_explained_where_they_stand(two_effects: Diagnosis):
    """77 % of the gap were an effect's, which closed 95 % of it, and nothing said why."""

    def said(share: float) -> str:
        of_channel = EffectShare("joint_spring", "a", share, (share - 0.1, share + 0.1))
        channel = ChannelBudget(0.04, 0.2, (of_channel,), (), 1.0 - share, 1.0, "N·m")
        named = Named("joint_spring", "a", share, 0.99, {}, 50.0)
        return replace(two_effects, budget=Budget({"a": channel}, (named,))).summary()

    text = said(0.6)
    assert "adding both closes 98 %" in text and "joint spring at a 60 %" in text
    assert "here named effects take 60 %, and the accepted effects close 98 %: both are right" in text
    assert "both are right" not in said(0.97)


def test_a_number_without_a_unit_has_none(two_effects: Diagnosis):
    assert "periods_per_rev 13\n" in two_effects.summary() + "\n"


def test_a_budget_in_which_nothing_is_named_says_how_near_to_the_noise_the_gap_is() -> None:
    channels = {
        "a": ChannelBudget(0.1, 0.11, (), (), 1.0, 0.5, "N·m"),
        "b": ChannelBudget(0.02, 0.03, (), (), 1.0, 0.5, "N·m"),
    }
    said = Budget(channels, ()).sentence()
    assert "b: 0.03 N·m, noise 0.02 N·m, 1.5 times as much" in said
    assert "%" not in said


def test_a_gap_that_is_no_more_than_its_noise_stands_above_none() -> None:
    """Of 0.000123 N·m beside a noise of 0.000123 N·m was said that it stands furthest above the noise."""
    within = {"a": ChannelBudget(0.000123, 0.000123, (), (), 1.0, 0.0, "N·m")}
    assert "furthest" not in Budget(within, ()).sentence()
    assert "stands above its noise" in Budget(within, ()).sentence()
    above = within | {"b": ChannelBudget(3.0, 3.3, (), (), 1.0, 1.0, "N·m")}
    assert "at b: 3.3 N·m, noise 3 N·m, 1.1 times as much" in Budget(above, ()).sentence()


def test_a_ripple_is_as_high_as_both_its_parts():
    """One of 4.9 N·m, whose phase left 0.03 to the cosine, was said to be one of -0.026 ± 0.02 N·m."""
    parts = {"cosine": Estimate(-0.03, 0.02, "N·m"), "sine": Estimate(4.86, 0.04, "N·m")}
    ripple = Candidate("torque_ripple", "a", parts, 640.0, 0.1, 0.9, ("a",))
    assert describe_with_size(ripple) == "torque ripple at a (4.86 ± 0.04 N·m)"


def test_of_several_axes_the_one_that_is_not_zero_is_told():
    """A bias of 4 N·m about y was told as that of the force along x, which is nothing."""
    parts = {
        "fx": Estimate(-0.32, 0.2, "N"),
        "fz": Estimate(0.05, 0.08, "N"),
        "ty": Estimate(3.8, 0.1, "N·m"),
    }
    bias = Candidate("sensor_bias", "foot", parts, 1.0, 0.0, 1.0)
    assert describe_with_size(bias) == "sensor bias at foot (ty 3.8 ± 0.1 N·m)"
    body = {"mass": Estimate(1.2, 0.1, "kg"), "mx": Estimate(0.3, 0.001, "kg·m")}
    assert (
        describe_with_size(Candidate("payload", "hand", body, 1.0, 0.0, 1.0))
        == "payload at hand (1.2 ± 0.1 kg)"
    )


@pytest.mark.parametrize(
    ("unit", "of", "headline"), [("N·m", "the whole", "gap"), ("rad", "servo", "gap of the positions")]
)
def test_what_closed_means_is_said(two_effects: Diagnosis, unit: str, of: str, headline: str) -> None:
    """Without torques the gap is one of positions, and what each effect closes one of the servo's torques."""
    gap = replace(two_effects.gap, per_channel={"a": ChannelGap(2.0, 0.5, 0.4, unit)})
    said = replace(two_effects, gap=gap).summary().splitlines()
    assert f"closes 98 % of the {headline} above the noise" in said[0]
    note = next(line for line in said if line.startswith("(closed:"))
    assert of in note
    assert "together with those before it, every other one alone" in note


def test_a_ripple_that_grows_with_the_load_is_as_high_as_that_part():
    """Of a harmonic drive's waves of 0.06 times the load the sentence said 0.009 ± 0.03 N·m."""
    parts = {
        "cosine": Estimate(0.006, 0.02, "N·m"),
        "sine": Estimate(0.006, 0.04, "N·m"),
        "cosine_load": Estimate(0.03, 0.01, "N·m/(N·m)"),
        "sine_load": Estimate(0.04, 0.01, "N·m/(N·m)"),
        "periods_per_rev": Estimate(200.0, None, "1"),
    }
    ripple = Candidate("torque_ripple", "a", parts, 640.0, 0.1, 0.9, ("a",))
    assert describe_with_size(ripple) == "torque ripple at a (0.05 ± 0.01 N·m/(N·m))"


def test_an_interval_of_shares_has_no_sign_before_zero_and_two_ends_only_where_they_differ(
    two_effects: Diagnosis,
) -> None:
    shares = (
        EffectShare("joint_spring", "a", 0.998, (0.996, 1.001)),
        EffectShare("stribeck", "b", -0.001, (-0.002, 0.05)),
    )
    channel = ChannelBudget(0.04, 0.2, shares, (), 0.003, 1.0, "N·m")
    lines = replace(two_effects, budget=Budget({"a": channel}, ())).summary().splitlines()
    rows = [" ".join(line.split()) for line in lines]
    assert "a 100% 100% joint spring at a" in rows
    assert any(row.startswith("a 0% 0…5% stribeck at b") for row in rows), rows
