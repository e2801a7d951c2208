"""A command as it was typed, less what its results do not depend on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from excite.cli.session.output import command_line

# Where results go, how they are shown, and how many processes make them.
_TAKEN, _FLAGS = ("--out", "--jobs", "--cluster", "-o"), ("--json", "--resume")


def typed_command(arguments: Sequence[str]) -> str:
    """The command line of the program's arguments.

    >>> typed(["plan", "ur10", "--jobs", "4", "--candidates", "6", "--out=arm", "--json"])
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
