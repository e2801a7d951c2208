"""Options that every command takes, declared once."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import excite
from excite.cli.session.output import command_line
from excite.errors import InputError
from excite.folder_lock import claim_folder
from excite.parallel.cluster import executor
from excite.parallel.jobs import AtMost, Jobs, check_jobs
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


RobotArgument = Annotated[
    str,
    typer.Argument(
        metavar="ROBOT",
        help="Bundled robot (see `excite robots`), or path to a robot.yaml, URDF, xacro or MJCF.",
        autocompletion=complete_robots,
    ),
]
MotionArgument = Annotated[
    list[Path],
    typer.Argument(metavar="MOTION…", help="Motion files (.parquet, .csv, .npz) or folders of them."),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON document on stdout and nothing else.")
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of all random numbers.")]
JobsOption = Annotated[
    int | None,
    typer.Option(
        "--jobs",
        help="Processes to use; the result does not depend on it.",
        show_default="up to one a core",
        callback=_possible_jobs,
    ),
]
ClusterOption = Annotated[
    str | None,
    typer.Option(
        "--cluster",
        metavar="ADDRESS",
        help="Dask scheduler whose workers are to be used instead, such as tcp://10.0.0.1:8786.",
    ),
]


def _named_arguments(context: typer.Context, given: list[str] | None) -> list[str] | None:
    for one in given or []:
        if ":=" not in one:
            raise typer.BadParameter(f"{one!r} is not name:=value", param_hint="'--xacro-arg'")
    return given


PackagePathOption = Annotated[
    list[Path] | None,
    typer.Option("--package-path", help="Folder of ROS packages of the robot's model (may be repeated)."),
]
XacroArgOption = Annotated[
    list[str] | None,
    typer.Option(
        "--xacro-arg",
        metavar="NAME:=VALUE",
        help="Argument of the robot's xacro file (may be repeated).",
        callback=_named_arguments,
    ),
]
LimitsOption = Annotated[
    Path | None,
    typer.Option(
        "--limits",
        metavar="FILE",
        help="Joint limits of the robot that hold where they are tighter, MoveIt's joint_limits.yaml.",
    ),
]
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
OutOption = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Folder that results are written to.", callback=_usable_folder),
]


# Options that say how a robot's model is read, of every command that takes a robot.

# Parameters of commands that are a robot: a name or a file.
_ROBOTS = {"robot", "whose"}
_OPTIONS = {"package_path": PackagePathOption, "xacro_arg": XacroArgOption, "limits": LimitsOption}


def stated_source(
    package_path: list[Path] | None, xacro_arg: list[str] | None, limits: Path | None
) -> Source:
    """How a model is to be read, from the options as they were given."""
    arguments = dict(one.split(":=", 1) for one in xacro_arg or [])
    return Source(package_path=tuple(package_path or ()), arguments=arguments, limits=limits)


def with_model_options(command: Callable[..., None]) -> Callable[..., None]:
    """A command, with these options if it takes a robot; models that it loads are read as they say."""
    # Evaluated: what annotations say by name is known where the command stands, not here.
    signature = inspect.signature(command, eval_str=True)
    if not _ROBOTS & set(signature.parameters):
        return command

    @wraps(command)
    def run(
        *args: Any, package_path: Any = None, xacro_arg: Any = None, limits: Any = None, **named: Any
    ) -> None:
        with models_read_by(stated_source(package_path, xacro_arg, limits)):
            command(*args, **named)

    added = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=option)
        for name, option in _OPTIONS.items()
    ]
    run.__signature__ = signature.replace(parameters=[*signature.parameters.values(), *added])  # type: ignore[attr-defined]
    run.__annotations__ = {**inspect.get_annotations(command, eval_str=True), **_OPTIONS}
    return run


# What is known of single segments, as options: symmetry that does not hold, ranges of masses.

_ALL = "all"
# The setting that makes an option mean something: of others that know the same segments no option asks for symmetry.
_SETTINGS = {"--asymmetric": "mirror", "--mass-range": "segment_mass_range"}

AsymmetricOption = Annotated[
    list[str] | None,
    typer.Option(
        "--asymmetric",
        metavar="SEGMENT",
        help="hqp: a segment whose other side need not mirror it, as after an amputation, with a prosthesis or a "
        "weight worn; `all` frees every pair (may be repeated).",
    ),
]
MassRangeOption = Annotated[
    list[str] | None,
    typer.Option(
        "--mass-range",
        metavar="[SEGMENT=]SHARE",
        help="hqp: how far a mass may lie from nominal, as share of it (0.35 where not given); without SEGMENT for "
        "all (may be repeated).",
    ),
]


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


# Who does a command's work: ``--jobs`` or ``--cluster``.


@contextmanager
def requested_workers(jobs: int | None, cluster: str | None) -> Iterator[Jobs]:
    """What the options of a command ask for; up to one process a core where the work is long, if neither is given."""
    if cluster is None:
        yield jobs or AtMost(os.cpu_count() or 1)
        return
    if jobs is not None:
        raise typer.BadParameter("give this or --jobs, not both", param_hint="'--cluster'")
    with executor(cluster) as found:
        yield found
