"""The rules from columns to channels, each alone on a state of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.conversion.explicit_mapping import Map
from excite.conversion.guess import RULES, Guessing, guess_columns
from excite.conversion.guesses import Guesses
from excite.conversion.recording import Column, Recording, Stream, load_machine

TIME = np.arange(400) / 100.0
NAMES = tuple(rule.name for rule in RULES)


@pytest.fixture(scope="module")
def machine():
    return load_machine("ur10")


def recorded(machine, **columns: np.ndarray) -> Recording:
    """A recording of positions ``q_1`` … and what else is given, under names with a number a joint."""
    motion = {"q": np.sin(np.outer(TIME, 1.0 + 0.1 * np.arange(machine.n)))} | columns
    found = [
        Column(f"{name}_{k + 1}", values[:, k])
        for name, values in motion.items()
        for k in range(values.shape[1])
    ]
    return Recording("run.csv", "run", (Stream("", tuple(found)),))


def after(recording: Recording, machine, last: str, mapping: Map | None = None) -> Guessing:
    """The state after the rules up to one."""
    state = Guessing(Guesses(), recording, machine, mapping or Map(), machine.joints)
    for rule in RULES[: NAMES.index(last) + 1]:
        if rule.applies(state):
            rule.change(state)
    return state


def test_every_rule_has_a_name_of_its_own_and_says_what_it_finds():
    assert len(set(NAMES)) == len(NAMES)
    assert all(rule.finds for rule in RULES)


def test_names_alone_make_families_of_all_joints(machine):
    state = after(recorded(machine, tau=np.cos(np.outer(TIME, np.ones(6)))), machine, "families")
    assert {family.target: len(family.placed.columns) for family in state.groups} == {"q": 6, "tau": 6}


def test_a_field_that_nobody_filled_is_left_out_by_its_rule_alone(machine):
    recording = recorded(machine, tau=np.zeros((len(TIME), 6)))
    before, then = (after(recording, machine, name) for name in ("axes", "no measurements"))
    assert "tau" in {family.target for family in before.groups}
    assert "tau" not in {family.target for family in then.groups}
    assert any("was not filled" in why for _, _, why in then.found.facts)


def test_one_dead_torque_among_live_ones_stays(machine):
    torque = np.cos(np.outer(TIME, 1.0 + np.arange(6)))
    torque[:, 2] = 0.0
    assert "tau" in {
        f.target for f in after(recorded(machine, tau=torque), machine, "no measurements").groups
    }


def test_a_rate_is_asked_for_where_no_clock_is_and_read_where_one_is(machine):
    recording = recorded(machine)
    assert [question.key for question in after(recording, machine, "clock").found.questions] == ["rate"]
    (stream,) = recording.streams
    timed = replace(stream, columns=(Column("time", TIME), *stream.columns))
    state = after(replace(recording, streams=(timed,)), machine, "clock")
    assert list(state.clocks) == ["time"] and not state.found.questions


def test_rules_of_what_moves_freely_do_not_apply_to_an_arm(machine):
    state = Guessing(Guesses(), recorded(machine), machine, Map(), machine.joints)
    idle = {rule.name for rule in RULES if not rule.applies(state)}
    assert {"base", "own base"} <= idle


def test_units_are_not_converted_while_a_question_is_open(machine):
    found = guess_columns(recorded(machine, tau=np.cos(np.outer(TIME, np.ones(6)))), machine, Map())
    assert found.questions and all(item.factor == 1.0 for item in found.mapped)


def named(**groups: np.ndarray) -> Recording:
    """A recording of columns called ``NAME_1`` … for each group, beside a time."""
    found = [Column("time", TIME)]
    for name, values in groups.items():
        found += [Column(f"{name}_{k + 1}", values[:, k]) for k in range(values.shape[1])]
    return Recording("run.csv", "run", (Stream("", tuple(found)),))


WAVES = np.sin(np.outer(TIME, 1.0 + 0.2 * np.arange(6)))
NOISE = np.random.default_rng(0).standard_normal(WAVES.shape)
LATE = np.sin(np.outer(TIME - 0.02, 1.0 + 0.2 * np.arange(6)))
UNTIMED = named(q=WAVES, v=np.gradient(WAVES, TIME, axis=0))
FIRST = "shoulder_pan_joint"


def chosen(channel: str):
    return lambda state: state.chosen[channel].columns[0] if channel in state.chosen else ""


def asked(state: Guessing) -> set[str]:
    return {question.key for question in state.found.questions}


def placed(channel: str):
    return lambda state: {c for f in state.groups if f.target == channel for c in f.placed.columns.values()}


# By rule: what is recorded, what a map says, what is looked at, and how that is before and after the rule.
ALONE = {
    "map": (
        named(pos=WAVES),
        {"columns": {"q": "pos_{n}"}},
        lambda s: len(s.found.of("q")),
        0,
        6,
    ),
    "stated joints": (
        named(q=WAVES, other=WAVES[:, :1]),
        {"columns": {f"q.{FIRST}": "other_1"}},
        lambda s: "q_1" in placed("q")(s),
        True,
        False,
    ),
    "axes": (named(A=WAVES), {}, lambda s: {f.target for f in s.groups}, {"a"}, {"q"}),
    "no measurements": (
        named(q=WAVES, foot_force=WAVES[:, :2]),
        {},
        lambda s: "foot_force_1" in {c for f in s.groups for c in f.columns},
        True,
        False,
    ),
    "choice": (named(q=WAVES, q_des=LATE), {}, chosen("q"), "", "q_1"),
    "torques": (named(target_q=WAVES, target_torque=LATE), {}, asked, set(), {"nothing measured"}),
    "commands": (named(q=WAVES, action=NOISE), {}, asked, set(), {"unfollowed commands"}),
    "doubtful choice": (named(q=np.hstack([WAVES, LATE])), {}, asked, set(), {"surplus"}),
    "channels": (named(q=WAVES), {}, lambda s: len(s.found.of("q")), 0, 6),
    "rate": (
        replace(UNTIMED, streams=(replace(UNTIMED.streams[0], columns=UNTIMED.streams[0].columns[1:]),)),
        {},
        lambda s: s.found.questions[0].line.split("   #")[0],
        "log: {rate_hz: NUMBER}",
        "log: {rate_hz: 100}",
    ),
    "lacking motion": (named(tau=WAVES), {}, asked, set(), {"no positions"}),
    "lacking torques": (named(q=WAVES, pwm=LATE), {}, asked, set(), {"no torques"}),
    "units": (
        named(q=np.degrees(3.0 * WAVES)),
        {},
        lambda s: {round(item.factor, 4) for item in s.found.of("q")},
        {1.0},
        {0.0175},
    ),
    "unused": (named(q=WAVES, temp=LATE[:, :1]), {}, lambda s: s.found.unused, [], ["temp_1"]),
}


@pytest.mark.parametrize("name", ALONE)
def test_a_rule_finds_what_it_says_and_the_rules_before_it_do_not(name, machine):
    recording, mapping, look, before, then = ALONE[name]
    stated = Map.model_validate(mapping)
    last = NAMES[NAMES.index(name) - 1]
    assert look(after(recording, machine, last, stated)) == before
    assert look(after(recording, machine, name, stated)) == then
