"""Options that say how a robot's model is read, of every command that takes a robot."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

from excite.cli.session.options import LimitsOption, PackagePathOption, XacroArgOption
from excite.robot.scaffold.source import Source, models_read_by

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
