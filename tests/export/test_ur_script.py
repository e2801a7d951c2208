"""URScript programs, run by a small interpreter of what they use of the language."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from excite.errors import InputError
from excite.export.export import export_motion
from excite.motion.collection import library_folder
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.robot.loading import load_robot
from excite.robot.robot import Robot


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


@pytest.fixture(scope="module")
def arm() -> Robot:
    return load_robot("ur10")


@pytest.fixture(scope="module")
def motion(arm: Robot) -> Motion:
    return load_motion(library_folder("ur10") / "motions" / "random_joint_015.parquet", arm)


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


def test_settings_are_the_servos_and_are_kept_within_the_manuals_ranges(
    arm: Robot, motion: Motion, tmp_path: Path
) -> None:
    settings = {"lookahead": "0.05", "gain": 500, "settle": 0, "confirm": "no"}
    done = run(export_motion(motion, arm, "ur-script", tmp_path / "a", settings=settings).read_text())
    assert not done.questions and done.of("servoj")[0][1] == [0.0, 0.0, 0.002, 0.05, 500.0]
    for name, value in (("lookahead", 0.3), ("gain", 99), ("gain", "much"), ("confirm", "perhaps")):
        with pytest.raises(InputError, match=f"ur-script: {name}: is "):
            export_motion(motion, arm, "ur-script", tmp_path / "b", settings={name: value})
    with pytest.raises(InputError, match="rate_hz: is 250 Hz, and the controller runs at 500 or 125 Hz"):
        export_motion(motion, arm, "ur-script", tmp_path / "b", 250.0)
    assert [path.name for path in tmp_path.iterdir()] == ["a.script"]


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


@pytest.mark.parametrize("name", ["panda", "jaco2", "go2", "hrp2like"])
def test_other_robots_are_refused_in_one_line(name: str, tmp_path: Path) -> None:
    robot = load_robot(name)
    n = 5
    q = np.tile(robot.rest, (n, 1))
    zero = np.zeros((n, robot.model.nv))
    still = Motion("still", robot.name, robot.joint_names, np.arange(n) * 0.01, q, zero, zero)
    with pytest.raises(
        InputError, match=rf"ur-script: robot '{name}' is no chain of 6 joints that turn on a fixed base"
    ) as caught:
        export_motion(still, robot, "ur-script", tmp_path / "still")
    assert "\n" not in str(caught.value) and not list(tmp_path.iterdir())
