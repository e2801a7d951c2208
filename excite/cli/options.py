"""Commands and their options, which ``options.csv`` holds; help ends with the lines of ``examples.csv``."""

from __future__ import annotations

import inspect
import json
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
from excite.atomic import claim_folder
from excite.campaign.searches import MIXTURE, SEARCHES
from excite.cli.output import command_line, print_document, progress_bars
from excite.data_tables import read_rows
from excite.errors import InputError
from excite.export.registry import EXPORTERS, MODEL_FORMATS
from excite.identification.estimators.registry import ESTIMATORS
from excite.logs.vocabulary import EFFECTS
from excite.motion.generators.registry import GENERATORS
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


# Lists of words that options take, and that the shell completes; a registry of them is not loaded.
_WORDS: dict[str, Callable[[], Iterable[str]]] = {
    "robots": bundled_robots,
    "methods": lambda: ESTIMATORS,
    "models": lambda: MODEL_FORMATS,
    "exporters": lambda: EXPORTERS,
    "generators": lambda: [*GENERATORS, *SEARCHES, MIXTURE],
    "effects": lambda: EFFECTS,
}


def _complete_words(words: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    # typer goes by the name of the argument.
    def complete_word(incomplete: str) -> list[str]:
        return [name for name in words() if name.startswith(incomplete)]

    return complete_word


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
        """Print the summary and the command to go on with, or the document where ``--json`` was given."""
        if self.as_json:
            print_document(document)
            return
        print(summary)
        if then:
            print(f"then: {then}")


COMMANDS: dict[str, Callable[..., None]] = {}
"""By name, what does the work of each command; the modules of the commands fill it."""


def register_command(name: str, **shared: bool) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Of a function: it does the work of the command of that name, with options as :func:`with_shared_options`."""

    def register_work(work: Callable[..., None]) -> Callable[..., None]:
        COMMANDS[name] = with_shared_options(name, **shared)(work)
        return work

    return register_work


def with_shared_options(
    name: str = "", *, out: bool = True, cluster: bool = False
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Of a function: it has every option declared that it is given as its :class:`Call`; models are read as they say.

    Args:
        name: of the command, as the table of options has it.
        out: whether there is a folder for results, where the function declares none of its own.
        cluster: whether others may do the work.
    """

    def declare_options(work: Callable[..., None]) -> Callable[..., None]:
        # Evaluated: what annotations say by name is known where the function stands, not here.
        own = dict(inspect.signature(work, eval_str=True).parameters)
        called = own.pop("call", None) is not None
        asked = ["out"] if out and called and "out" not in own else []
        asked += [*_EVERY, *(["cluster"] if cluster else [])]
        added = [] if _ROBOTS.isdisjoint(own) else [one for one in _SOURCE if one not in own]
        shared = [*(_CALL[one] for one in asked), *(_SOURCE[one] for one in added)]
        found = [_declare_parameter(name, one) for one in (*own.values(), *shared)]

        @wraps(work)
        def run_work(**given: Any) -> None:
            model = {name: given.pop(name) for name in added}
            call = Call(**{name: given.pop(name) for name in asked})
            with models_read_by(stated_source(**model)) if added else nullcontext():
                work(**given, **({"call": call} if called else {}))

        run_work.__signature__ = inspect.Signature(found)  # type: ignore[attr-defined]
        run_work.__annotations__ = {one.name: one.annotation for one in found}
        return run_work

    return declare_options


def _declare_parameter(command: str, one: inspect.Parameter) -> inspect.Parameter:
    """A parameter with its row of the table, its command's own or that of all, unless it declares an option itself."""
    row = _TABLE.get((command, one.name)) or _TABLE.get(("", one.name))
    annotation = one.annotation
    if row is not None and get_origin(annotation) is not Annotated:
        words = {name: ", ".join(_WORDS[name]()) for name in _WORDS if f"{{{name}}}" in row["help"]}
        low, high = (json.loads(end or "null") for end in (row["range"] or "..").split(".."))
        more: dict[str, Any] = {
            "help": row["help"].format(**words),
            "metavar": row["metavar"] or None,
            "min": low,
            "max": high,
            "autocompletion": _COMPLETIONS.get(row["words"]),
            "callback": _CHECKS.get(row["check"]),
            "show_default": row["default"] or True,
        }
        flags = row["flags"].split()
        annotation = Annotated[annotation, typer.Option(*flags, **more) if flags else typer.Argument(**more)]
    return one.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=annotation)


def stated_source(
    package_path: list[Path] | None = None, xacro_arg: list[str] | None = None, limits: Path | None = None
) -> Source:
    """How a model is to be read, from the options as they were given."""
    arguments = dict(one.split(":=", 1) for one in xacro_arg or [])
    return Source(package_path=tuple(package_path or ()), arguments=arguments, limits=limits)


# By command and parameter; types and defaults are the functions' own. Rows without a command are for all of them.
_TABLE = {(row["command"], row["parameter"]): row for row in read_rows(__file__, "options.csv")}
_COMPLETIONS = {name: _complete_words(words) for name, words in _WORDS.items()}
_CHECKS = {"folder": _usable_folder, "jobs": _possible_jobs, "arguments": _named_arguments}
# Options of every command, whether its work depends on them or not.
_EVERY = ("as_json", "seed", "jobs")
_CALL = inspect.signature(Call, eval_str=True).parameters
# Options that say how a robot's model is read, of every command with a parameter that is a robot: a name or a file.
_SOURCE, _ROBOTS = inspect.signature(stated_source, eval_str=True).parameters, {"robot", "whose"}

# What is known of single segments, as options: symmetry that does not hold, ranges of masses.

_ALL = "all"


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
        # The setting that makes an option mean something: of others that know the same segments no option asks for
        # symmetry.
        able = methods_with({"--asymmetric": "mirror", "--mass-range": "segment_mass_range"}[option])
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

EXAMPLES: dict[str, list[tuple[str, str]]] = {}
for _row in read_rows(__file__, "examples.csv"):
    EXAMPLES.setdefault(_row["command"], []).append((_row["line"], _row["meaning"]))


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
        """Write the methods of a command that identifies, and then the examples, after the options."""
        # The name without the program's, which may have been started as a module.
        name = ctx.command_path.split(" ", 1)[-1]
        # Commands whose help names the methods; these are loaded only when that help is shown.
        if name in ("identify", "campaign"):
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
