"""URScript programs, run by a small interpreter of what they use of the language."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from excite.export.export import export_motion
from excite.motion.motion import Motion
from excite.robot.robot import Robot

ROBOT = "ur10"


@dataclass
class Run:
    """What a program made the arm do."""

    calls: list[tuple[str, list[float] | None, list[float]]] = field(default_factory=list)
    questions: list[str] = field(default_factory=list)

    def of(self, name: str) -> list[tuple[list[float] | None, list[float]]]:
        return [(q, rest) for called, q, rest in self.calls if called == name]


def run(text: str) -> Run:
    """Run one function of calls, and of loops that count up to a number."""
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    assert re.fullmatch(r"def [A-Za-z][A-Za-z0-9_]*\(\):", lines[0]) and lines[-1] == "end"
    done, loop, turns = Run(), [], 0
    for line in lines[1:-1]:
        word = line.strip()
        if match := re.fullmatch(r"while held < (\d+):", word):
            loop, turns = ["while"], int(match[1])
        elif word == "end":
            for _ in range(turns):
                for inner in loop[1:]:
                    call(inner, done)
            loop = []
        elif loop:
            loop.append(word)
        else:
            call(word, done)
    assert not loop
    return done


def call(word: str, done: Run) -> None:
    if re.fullmatch(r"held = (0|held \+ 1)", word):
        return
    match = re.fullmatch(r"(movej|servoj|stopj|popup)\((.*)\)", word)
    assert match, word
    if match[1] == "popup":
        done.questions.append(match[2])
        return
    posture = re.match(r"\[([^\]]*)\], ", match[2])
    q = [float(value) for value in posture[1].split(",")] if posture else None
    rest = match[2][posture.end() if posture else 0 :]
    done.calls.append((match[1], q, [float(value.split("=")[-1]) for value in rest.split(",")]))


@pytest.mark.parametrize(("asked", "rate"), [(None, 500), (125.0, 125)])
def test_the_program_goes_to_the_start_runs_every_sample_and_stops(
    asked: float | None, rate: int, arm: Robot, motion: Motion, tmp_path: Path
) -> None:
    path = export_motion(motion, arm, "ur-script", tmp_path / "first", asked)
    done = run(path.read_text())
    ((start, approach),) = done.of("movej")
    servo = done.of("servoj")
    assert done.calls[0][0] == "movej" and done.calls[-1][0] == "stopj" and len(done.of("stopj")) == 1
    assert approach == [0.35, 0.25] and start == servo[0][0]
    assert all(rest == [0.0, 0.0, 1 / rate, 0.1, 300.0] for _, rest in servo)
    held = rate // 2
    assert {tuple(q) for q, _ in servo[-held:]} == {tuple(servo[-1][0])}
    time = np.arange(len(servo) - held) / rate
    assert motion.duration <= time[-1] < motion.duration + 1 / rate + 1e-9
    expected = CubicHermiteSpline(motion.time - motion.time[0], motion.q, motion.v)(
        time.clip(max=motion.duration)
    )
    sent = np.array([q for q, _ in servo[:-held]])
    np.testing.assert_allclose(sent, expected, atol=1e-4)
    np.testing.assert_allclose(sent[-1], motion.q[-1], atol=1e-12)


def test_settings_are_the_servos(arm: Robot, motion: Motion, tmp_path: Path) -> None:
    settings = {"lookahead": "0.05", "gain": 500, "settle": 0, "confirm": "no"}
    done = run(export_motion(motion, arm, "ur-script", tmp_path / "a", settings=settings).read_text())
    assert not done.questions and done.of("servoj")[0][1] == [0.0, 0.0, 0.002, 0.05, 500.0]


def test_the_operator_is_asked_and_told_of_an_unsafe_motion(
    arm: Robot, motion: Motion, tmp_path: Path
) -> None:
    path = export_motion(motion, arm, "ur-script", tmp_path / "2 nd 'name'")
    assert path.read_text().count("def motion_2_nd__name__():") == 0  # named by the motion, not by the file
    (question,) = run(path.read_text()).questions
    assert question.startswith(f'"motion {motion.name} of robot ur10') and question.count('"') == 4
    named = motion.renamed('2 "nd"\nname')
    program = export_motion(named, arm, "ur-script", tmp_path / "n").read_text()
    assert "def motion_2__nd__name():" in program and run(program).questions[0].count('"') == 4
