"""Help of the commands: it ends with examples, and of those that identify it names the methods before them."""

from __future__ import annotations

import re
from typing import Any

from typer.core import TyperCommand

import excite

# What stands at the end of every command's help: lines that can be typed as they are, each with what it does.
#
# The lines tell one story, so that what one of them reads an earlier one has written.

EXAMPLES: dict[str, tuple[tuple[str, str], ...]] = {
    "robots": (("excite robots", "what is bundled"), ("excite robots --json", "the same for a program")),
    "init-robot": (
        ("excite init-robot arm.urdf --out my_arm", "my_arm/robot.yaml, to be read and corrected"),
        (
            "excite init-robot arm.urdf.xacro --package-path src --xacro-arg hand:=false --out my_arm",
            "of a xacro file in a ROS workspace",
        ),
        ("excite init-robot arm.urdf --srdf arm.srdf --out my_arm", "with MoveIt's pairs that may touch"),
    ),
    "plan": (
        ("excite plan ur10 --candidates 60 --out arm", "motions, plan.json and report.html in arm"),
        ("excite plan my_arm/robot.yaml --out mine", "for a robot of your own"),
        ("excite plan ur10 --joint elbow_joint --candidates 20 --out elbow", "aimed at one joint"),
        ("excite plan ur10 --select log_det --budget 120 --out short", "the best two minutes"),
        ("excite plan ur10 --generator optimised_fourier --candidates 2 --out best", "optimised series"),
    ),
    "check": (
        ("excite check ur10 arm", "the verdict on every motion in arm"),
        ("excite check --robot ur10 mine.csv", "of a motion made elsewhere"),
    ),
    "rank": (
        ("excite rank ur10 arm", "best first, and all of them together"),
        ("excite rank ur10 arm --out arm", "written to arm/rank.json too"),
    ),
    "export": (
        ("excite export arm/motions --format csv --rate 1000 --out commands", "a table a motion"),
        ("excite export arm/motions --format ros2-yaml --set controller=arm_controller --out goals", "ROS 2"),
        ("excite export arm/motions --format ur-script --set gain=400 --approach --out programs", "a UR"),
    ),
    "capture": (
        ("excite capture ur10 arm", "arm/capture.md, to print"),
        ("excite capture ur10 arm --out sheet.html", "the same as a page"),
    ),
    "simulate": (
        ("excite simulate ur10 arm --out arm_log", "a virtual robot that is not the model"),
        ("excite simulate ur10 arm --nominal --inject payload:wrist_3_link --out odd_log", "with a load"),
        ("excite simulate ur10 arm --inject torque_gain:elbow_joint:1.1 --out gain_log", "a gain 10 % off"),
    ),
    "init-log": (
        ("excite init-log recordings", "recordings/log.yaml, with marks where a person must fill in"),
    ),
    "convert": (
        ("excite convert monday.mcap --robot ur10 --out arm_log", "a log folder of a recording"),
        ("excite convert *.csv --robot ur10 --out arm_log --capture arm/capture.md", "checked by the sheet"),
        ("excite convert *.csv --robot ur10 --out arm_log --map map.yaml", "as a corrected map.yaml says"),
    ),
    "identify": (
        ("excite identify ur10 arm_log --out arm_result", "parameters, fit, URDF and MuJoCo model"),
        ("excite identify ur10 arm_log --method cls3 --out model", "by another method"),
        ("excite identify ur10 arm_log --bounds-template bounds.yaml", "what is known, to be edited, then:"),
        ("excite identify ur10 arm_log --method physical --bounds bounds.yaml --out known", "within bounds"),
        ("excite identify ur10 monday tuesday --sessions --out pooled", "several days, with their spread"),
    ),
    "identify-load": (
        ("excite identify-load ur10 bare loaded --mass 2.0", "a load that was on a scale"),
        (
            "excite identify-load ur10 bare loaded --calibration known --calibration-mass 2.5",
            "weighed by one that was",
        ),
        ("excite identify-load ur10 bare loaded --format ur --out load", "for the controller, as URScript"),
    ),
    "model": (
        ("excite model arm_result --format mjcf -o arm_mujoco", "the identified robot for MuJoCo"),
        ("excite model arm_result --format urdf --out arm_urdf", "for ROS, pinocchio, Drake"),
        ("excite model arm_result --format isaaclab --out arm_isaac", "an ArticulationCfg, and its USD"),
        (
            "excite model arm_result --robot arm.xml --format mjcf -o arm_mujoco",
            "of a robot that came as MJCF: its own text, other physics",
        ),
    ),
    "doctor": (
        ("excite doctor arm_log", "what is wrong with it, worst first"),
        ("excite doctor arm_log --repair sound_log", "and the log with what could be repaired"),
    ),
    "diagnose": (
        ("excite diagnose arm_log --out diagnosis", "report.html, diagnosis.json, augmented.xml"),
        ("excite diagnose arm_log --apply better --out first", "and the robot with what was found"),
        ("excite diagnose arm_log --robot better/robot.yaml --out second", "what is left then"),
    ),
    "effects": (("excite effects", "every effect, its law and what it is taken for"),),
    "human": (
        ("excite human walk.c3d --mass 70 --height 1.82 --sex male --out anna", "model and log folder"),
        (
            "excite human walk.c3d --mass 70 --height 1.82 --sex male --identify lmi --out anna",
            "segment masses too",
        ),
        (
            "excite human run.trc run.mot --mass 66 --height 1.8 --sex female --static standing.trc",
            "TRC, MOT",
        ),
    ),
    "campaign": (
        ("excite campaign ur10 --candidates 60 --target-rsd 10 --out campaign", "on a virtual robot"),
        ("excite campaign ur10 --on-robot --out campaign", "stops for you to record on the real one"),
        ("excite campaign ur10 --resume --out campaign", "and goes on, by the same options"),
    ),
    "report": (("excite report arm", "arm/report.html"),),
    "view": (
        ("excite view arm", "the plan's motions in the browser"),
        ("excite view diagnosis", "the robot as measured, the simulator beside it, residuals of each joint"),
        ("excite view arm_log --record arm_log.html", "a log as a page to send to somebody"),
    ),
    "schema": (
        ("excite schema log", "of log.yaml"),
        ("excite schema identification", "of identification.json"),
    ),
    "demo": (("excite demo --out demo", "some minutes, ends in demo/report.html"),),
}


METHOD_HELP = "Estimator, one of those below."


# What typer calls a type, such as <list[Path]> or <int range>, and what is to be typed.
_TYPE = re.compile(r"<(?:list\[)?(\w+)(?:\])?(?: range)?>")
_CHOICE = re.compile(r"<([^<>]*\|[^<>]*)>")
_TYPED = {"int": "NUMBER", "float": "NUMBER", "str": "TEXT", "path": "PATH", "file": "PATH"}


def _in_words(left: str) -> str:
    """The left column of a row of help: what is to be typed, not of which type of Python's it will be."""
    if not left.startswith("-"):
        # The name of an argument says what it is.
        return _TYPE.sub("", left).rstrip()
    return _CHOICE.sub(r"[\1]", _TYPE.sub(lambda found: _TYPED.get(found[1].lower(), found[0]), left))


class HelpfulCommand(TyperCommand):
    """A command whose help says what is to be typed, and ends with examples."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options."""
        write = formatter.write_dl

        def in_words(rows: Any, *arguments: Any, **options: Any) -> None:
            write([(_in_words(left), right) for left, right in rows], *arguments, **options)

        formatter.write_dl = in_words
        super().format_options(ctx, formatter)
        formatter.write_dl = write

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the examples after the options."""
        # The name without the program's, which may have been started as a module.
        name = ctx.command_path.split(" ", 1)[-1]
        with formatter.section("Examples"):
            for line, meaning in EXAMPLES[name]:
                # Not wrapped: a line is to be copied as it stands.
                formatter.write(f"{'':{formatter.current_indent}}{line}\n")
                formatter.indent()
                formatter.indent()
                formatter.write_text(meaning)
                formatter.dedent()
                formatter.dedent()


class MethodsCommand(HelpfulCommand):
    """A command that identifies: its help names the methods and when to take which.

    They are asked for only when this help is shown: the registry loads every estimator.
    """

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the methods after the options, and then the examples."""
        default = next((item.default for item in self.params if item.name == "method"), None)
        rows = [
            (
                f"{item.name} (default)" if item.name == default else item.name,
                f"{item.title}. For {item.use}.",
            )
            for item in excite.method_summaries()
        ]
        with formatter.section("Methods"):
            formatter.write_dl(rows)
        super().format_epilog(ctx, formatter)
