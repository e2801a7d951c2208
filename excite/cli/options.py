"""Commands and their options: those that several take are declared once; help ends with examples."""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, get_origin

import typer
from typer.core import TyperCommand

import excite
from excite.cli.output import command_line, emit_result, print_document, progress_bars
from excite.errors import InputError
from excite.folder_lock import claim_folder
from excite.identification.estimators.registry import DEFAULT_METHOD, ESTIMATORS
from excite.parallel.jobs import AtMost, Jobs, check_jobs, executor
from excite.progress import Progress
from excite.results import write_json
from excite.robot.catalogue import bundled_robots
from excite.robot.init_robot.source import Source, models_read_by

if TYPE_CHECKING:
    from excite.identification.estimators.settings import EstimatorSettings

# Words that the shell completes: bundled robots, formats, methods. ``excite --install-completion`` sets it
# up.

ASKED = "_EXCITE_COMPLETE"
"""What a shell sets that wants a line completed."""


def asked_to_complete() -> bool:
    """Whether a shell, and no person, has called."""
    return ASKED in os.environ


def one_of(names: Iterable[str]) -> Callable[[str], list[str]]:
    """Completion by names that begin with what was typed; a registry of them is not loaded."""

    # typer goes by the name of the argument.
    def matching(incomplete: str) -> list[str]:
        return [name for name in names if name.startswith(incomplete)]

    return matching


def complete_robots(incomplete: str) -> list[str]:
    """Bundled robots; files are the shell's own."""
    return [name for name in bundled_robots() if name.startswith(incomplete)]


def _usable_folder(context: typer.Context, folder: Path | None) -> Path | None:
    """The folder of results, refused before any work is done for it, and kept for this run until it ends."""
    if folder is None:
        return None
    if "\0" in str(folder):
        raise InputError("has a name that no folder can have", field="--out", remedy="give another --out")
    there = next(path for path in (folder, *folder.absolute().parents) if os.path.exists(path))
    if not there.is_dir():
        raise InputError("is a file, not a folder", source=there, remedy="give another --out")
    if not os.access(there, os.W_OK):
        raise InputError(
            "may not be written to", source=there, remedy="give another --out, or change its permissions"
        )
    context.with_resource(claim_folder(folder))
    return folder


def _possible_jobs(jobs: int | None) -> int | None:
    """The number of processes, refused where no machine runs as many."""
    if jobs is not None:
        try:
            check_jobs(jobs)
        except InputError as error:
            raise typer.BadParameter(f"{error.what}; {error.remedy}", param_hint="'--jobs'") from error
    return jobs


def _named_arguments(context: typer.Context, given: list[str] | None) -> list[str] | None:
    for one in given or []:
        if ":=" not in one:
            raise typer.BadParameter(f"{one!r} is not name:=value", param_hint="'--xacro-arg'")
    return given


# Options that several commands have: a parameter of such a name that no command declares itself is this option.
_SHARED: dict[str, tuple[Any, Any]] = {
    "robot": (
        Annotated[
            str,
            typer.Argument(
                metavar="ROBOT",
                help="Bundled robot (see `excite robots`), or path to a robot.yaml, URDF, xacro or MJCF.",
                autocompletion=complete_robots,
            ),
        ],
        inspect.Parameter.empty,
    ),
    "motions": (
        Annotated[
            list[Path],
            typer.Argument(metavar="MOTION…", help="Motion files (.parquet, .csv, .npz) or folders of them."),
        ],
        inspect.Parameter.empty,
    ),
    "method": (
        Annotated[
            str,
            typer.Option(
                "--method", help="Estimator, one of those below.", autocompletion=one_of(ESTIMATORS)
            ),
        ],
        DEFAULT_METHOD,
    ),
    "cutoff_hz": (
        Annotated[
            float | None,
            typer.Option("--cutoff", min=0.0, help="Cut-off of the zero-phase low-pass on all signals [Hz]."),
        ],
        None,
    ),
    "asymmetric": (
        Annotated[
            list[str] | None,
            typer.Option(
                "--asymmetric",
                metavar="SEGMENT",
                help="hqp: a segment whose other side need not mirror it, as after an amputation, with a prosthesis "
                "or a weight worn; `all` frees every pair (may be repeated).",
            ),
        ],
        None,
    ),
    "mass_range": (
        Annotated[
            list[str] | None,
            typer.Option(
                "--mass-range",
                metavar="[SEGMENT=]SHARE",
                help="hqp: how far a mass may lie from nominal, as share of it (0.35 where not given); without "
                "SEGMENT for all (may be repeated).",
            ),
        ],
        None,
    ),
    "out": (
        Annotated[
            Path | None,
            typer.Option(
                "--out", metavar="DIR", help="Folder that results are written to.", callback=_usable_folder
            ),
        ],
        None,
    ),
    "as_json": (
        Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout and nothing else.")],
        False,
    ),
    "seed": (Annotated[int, typer.Option("--seed", min=0, help="Seed of all random numbers.")], 0),
    "jobs": (
        Annotated[
            int | None,
            typer.Option(
                "--jobs",
                help="Processes to use; the result does not depend on it.",
                show_default="up to one a core",
                callback=_possible_jobs,
            ),
        ],
        None,
    ),
    "cluster": (
        Annotated[
            str | None,
            typer.Option(
                "--cluster",
                metavar="ADDRESS",
                help="Dask scheduler whose workers are to be used instead, such as tcp://10.0.0.1:8786.",
            ),
        ],
        None,
    ),
    "package_path": (
        Annotated[
            list[Path] | None,
            typer.Option(
                "--package-path", help="Folder of ROS packages of the robot's model (may be repeated)."
            ),
        ],
        None,
    ),
    "xacro_arg": (
        Annotated[
            list[str] | None,
            typer.Option(
                "--xacro-arg",
                metavar="NAME:=VALUE",
                help="Argument of the robot's xacro file (may be repeated).",
                callback=_named_arguments,
            ),
        ],
        None,
    ),
    "limits": (
        Annotated[
            Path | None,
            typer.Option(
                "--limits",
                metavar="FILE",
                help="Joint limits of the robot that hold where they are tighter, MoveIt's joint_limits.yaml.",
            ),
        ],
        None,
    ),
}
# Options of every command, whether its work depends on them or not.
_EVERY = ("as_json", "seed", "jobs")
# Options that say how a robot's model is read, of every command with a parameter that is a robot: a name or a file.
_MODEL, _ROBOTS = ("package_path", "xacro_arg", "limits"), {"robot", "whose"}

ApplyOption = Annotated[
    Path | None,
    typer.Option(
        "--apply",
        metavar="DIR",
        help="Write the robot with the effects found: robot.yaml and robot.urdf, for --robot of the next round.",
        callback=_usable_folder,
    ),
]
ModelOutOption = Annotated[
    Path,
    typer.Option(
        "--out", "-o", metavar="DIR", help="Folder that the model is written to.", callback=_usable_folder
    ),
]


class Work(NamedTuple):
    """What the work of a command is done with.

    Attributes:
        folder: of its results, which no other run writes to meanwhile.
        jobs: who works.
        progress: told as work proceeds.
    """

    folder: Path
    jobs: Jobs
    progress: Progress


@dataclass(frozen=True)
class Call:
    """What a command was asked beside its own options.

    Attributes:
        out: folder that results are written to; None where none was named.
        as_json: whether one JSON document is printed, and nothing else.
        seed: of all random numbers.
        jobs: number of processes; None where nobody said.
        cluster: scheduler whose workers are used instead.
    """

    out: Path | None = None
    as_json: bool = False
    seed: int = 0
    jobs: int | None = None
    cluster: str | None = None

    @contextmanager
    def requested_workers(self) -> Iterator[Jobs]:
        """Who works; up to one process a core where the work is long, if neither option is given."""
        if self.cluster is None:
            yield self.jobs or AtMost(os.cpu_count() or 1)
            return
        if self.jobs is not None:
            raise typer.BadParameter("give this or --jobs, not both", param_hint="'--cluster'")
        with executor(self.cluster) as found:
            yield found

    @contextmanager
    def working_in(self, default: str) -> Iterator[Work]:
        """The folder for results, workers, and bars of progress on a terminal."""
        with (
            claim_folder(self.out or Path(default)) as claimed,
            self.requested_workers() as crew,
            progress_bars() as progress,
        ):
            yield Work(claimed, crew, progress)

    def write_document(self, document: dict[str, Any], name: str) -> None:
        """Write a document where a folder was named."""
        if self.out is not None:
            write_json(document, self.out / name)

    def emit_result(self, summary: str, document: dict[str, Any], *, then: str = "") -> None:
        """Print the summary and the command to go on with, or the document."""
        emit_result(summary, document, as_json=self.as_json, then=then)

    def is_printed(self, document: dict[str, Any], name: str) -> bool:
        """Write a document where a folder was named, and print it where that was asked; whether it was."""
        self.write_document(document, name)
        if self.as_json:
            print_document(document)
        return self.as_json


COMMANDS: dict[str, Callable[..., None]] = {}
"""By name, what does the work of each command; the modules of the commands fill it."""


def command(name: str, **shared: bool) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Of a function: it does the work of the command of that name, with options as :func:`with_shared_options`."""

    def register(work: Callable[..., None]) -> Callable[..., None]:
        COMMANDS[name] = with_shared_options(**shared)(work)
        return work

    return register


def with_shared_options(
    *, out: bool = True, cluster: bool = False
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Of a function: it has every option declared that it is given as its :class:`Call`; models are read as they say.

    Args:
        out: whether there is a folder for results, where the function declares none of its own.
        cluster: whether others may do the work.
    """

    def declare_options(work: Callable[..., None]) -> Callable[..., None]:
        # Evaluated: what annotations say by name is known where the function stands, not here.
        own = inspect.signature(work, eval_str=True).parameters
        called = "call" in own
        asked = ["out"] if out and called and "out" not in own else []
        asked += [*_EVERY, *(["cluster"] if cluster else [])]
        added = [] if _ROBOTS.isdisjoint(own) else [name for name in _MODEL if name not in own]
        found = [_declared(one) for one in own.values() if one.name != "call"]
        found += [_declared(name) for name in (*asked, *added)]

        @wraps(work)
        def run(**given: Any) -> None:
            model = {name: given.pop(name) for name in added}
            call = Call(**{name: given.pop(name) for name in asked})
            with models_read_by(stated_source(**model)) if added else nullcontext():
                work(**given, **({"call": call} if called else {}))

        run.__signature__ = inspect.Signature(found)  # type: ignore[attr-defined]
        run.__annotations__ = {one.name: one.annotation for one in found}
        return run

    return declare_options


def _declared(one: inspect.Parameter | str) -> inspect.Parameter:
    """A parameter with the shared option of its name, unless it declares an option itself."""
    name = one if isinstance(one, str) else one.name
    itself = not isinstance(one, str) and get_origin(one.annotation) is Annotated
    if isinstance(one, inspect.Parameter) and (itself or name not in _SHARED):
        return one.replace(kind=inspect.Parameter.KEYWORD_ONLY)
    annotation, default = _SHARED[name]
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def stated_source(
    package_path: list[Path] | None, xacro_arg: list[str] | None, limits: Path | None
) -> Source:
    """How a model is to be read, from the options as they were given."""
    arguments = dict(one.split(":=", 1) for one in xacro_arg or [])
    return Source(package_path=tuple(package_path or ()), arguments=arguments, limits=limits)


# What is known of single segments, as options: symmetry that does not hold, ranges of masses.

_ALL = "all"
# The setting that makes an option mean something: of others that know the same segments no option asks for symmetry.
_SETTINGS = {"--asymmetric": "mirror", "--mass-range": "segment_mass_range"}


def segment_settings(
    method: str, asymmetric: list[str] | None, mass_range: list[str] | None, **others: Any
) -> EstimatorSettings:
    """Settings of the estimator from these options and others, of which None is left out.

    Raises:
        UnknownNameError: no such method.
        InputError: an option that the method does not use, or one that cannot be read.
    """
    from excite.identification.estimators.method_settings import methods_with  # lazy: numpy

    given = {name: value for name, value in others.items() if value is not None}
    for option, values in (("--asymmetric", asymmetric), ("--mass-range", mass_range)):
        able = methods_with(_SETTINGS[option])
        if values and method not in able:
            raise InputError(
                f"is not used by method {method!r}",
                field=option,
                remedy=f"choose method {' or '.join(able)}, or leave it out",
            )
    freed = tuple(asymmetric or ())
    if _ALL in freed:
        given["mirror"] = None
        freed = tuple(name for name in freed if name != _ALL)
    ranges = named_numbers("--mass-range", mass_range)
    if "" in ranges:
        given["mass_range"] = ranges.pop("")
    if freed:
        given["asymmetric"] = freed
    if ranges:
        given["segment_mass_range"] = ranges
    return excite.estimator_settings(method, **given)


def named_numbers(option: str, words: list[str] | None) -> dict[str, float]:
    """``SEGMENT=NUMBER`` words by segment, a number alone by the empty name.

    Raises:
        InputError: a word without a number that is finite and not negative, or a segment given twice.
    """
    found: dict[str, float] = {}
    for word in words or ():
        name, _, text = word.rpartition("=")
        try:
            number = float(text)
        except ValueError:
            number = -1.0
        if not 0.0 <= number < float("inf"):
            raise InputError(f"is {word!r}", field=option, remedy="write SEGMENT=NUMBER, left_shank=0.5")
        if name in found:
            raise InputError(f"is given twice for {name or 'all'}", field=option, remedy="give it once")
        found[name] = number
    return found


# A command as it was typed, less what its results do not depend on.

# Where results go, how they are shown, and how many processes make them.
_TAKEN, _FLAGS = ("--out", "--jobs", "--cluster", "-o"), ("--json", "--resume")


def typed_command(arguments: Sequence[str]) -> str:
    """The command line of the program's arguments.

    >>> typed_command(["plan", "ur10", "--jobs", "4", "--candidates", "6", "--out=arm", "--json"])
    'excite plan ur10 --candidates 6'
    """
    return command_line(*_kept_arguments(arguments))


def typed_seed(arguments: Sequence[str]) -> int:
    """The seed that the arguments state, 0 where they state none or one that will be refused."""
    seed = "0"
    for index, argument in enumerate(arguments):
        if argument == "--seed":
            seed = "".join(arguments[index + 1 : index + 2])
        elif argument.startswith("--seed="):
            seed = argument.removeprefix("--seed=")
    return int(seed) if seed.isdecimal() else 0


def _kept_arguments(arguments: Sequence[str]) -> Iterator[str]:
    skip = False
    for argument in arguments:
        if skip:
            skip = False
        elif argument in _TAKEN:
            skip = True
        elif argument not in _FLAGS and argument.split("=", 1)[0] not in _TAKEN:
            yield argument


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


# Commands whose help names the methods; these are loaded only when that help is shown.
_IDENTIFYING = ("identify", "campaign", "human")


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
        """Write the methods of a command that identifies, and then the examples, after the options."""
        # The name without the program's, which may have been started as a module.
        name = ctx.command_path.split(" ", 1)[-1]
        if name in _IDENTIFYING:
            default = next((item.default for item in self.params if item.name == "method"), None)
            rows = [
                (one.name + (" (default)" if one.name == default else ""), f"{one.title}. For {one.use}.")
                for one in excite.method_summaries()
            ]
            with formatter.section("Methods"):
                formatter.write_dl(rows)
        with formatter.section("Examples"):
            for line, meaning in EXAMPLES[name]:
                # Not wrapped: a line is to be copied as it stands.
                formatter.write(f"{'':{formatter.current_indent}}{line}\n")
                formatter.indent()
                formatter.indent()
                formatter.write_text(meaning)
                formatter.dedent()
                formatter.dedent()
