"""``excite export``: files for robot controllers."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

import excite
from excite.cli.session.options import JobsOption, JsonOption, MotionArgument, OutOption, SeedOption, one_of
from excite.cli.session.output import command_line, emit_result
from excite.export.registry import EXPORTERS
from excite.results import write_json

NAME = "export"


def command(
    motions: MotionArgument,
    format_name: Annotated[
        str,
        typer.Option(
            "--format",
            help=f"One of {', '.join(EXPORTERS)} (docs/formats.md says what reads each).",
            autocompletion=one_of(EXPORTERS),
        ),
    ],
    rate_hz: Annotated[
        float | None,
        typer.Option(
            "--rate",
            min=1e-3,
            help="Samples per second; the controller's, or the motion's own, where left out.",
        ),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(
            "--robot",
            help="Robot (bundled, a robot.yaml or a model), where the motions do not name a bundled one.",
        ),
    ] = None,
    unsafe_anyway: Annotated[
        str | None,
        typer.Option(
            "--unsafe-anyway",
            metavar="REASON",
            help="Write motions that fail the check all the same; reason and violations stand in what is written.",
        ),
    ] = None,
    approach: Annotated[
        bool,
        typer.Option(
            "--approach",
            help="Lead from the robot's rest posture to the start and back, checked with the motion.",
        ),
    ] = False,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="NAME=VALUE", help="A setting of the format, such as a gain; repeatable."
        ),
    ] = None,
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
) -> None:
    """Write motions in the format of a controller, if the independent check finds all of them safe."""
    from excite.export.export import export_with_verdicts, robot_beside  # lazy: pinocchio
    from excite.motion.collection import motion_paths  # lazy: pinocchio

    try:
        report = export_with_verdicts(
            motions,
            format_name,
            out=out or Path(),
            rate_hz=rate_hz,
            robot=robot,
            unsafe_anyway=unsafe_anyway,
            approach=approach,
            settings=_parse_settings(settings or []),
        )
    except excite.UnsafeMotionError as error:
        # One line each; the last one, which says what to do, is the error's own.
        for verdict in error.verdicts[1:]:
            print(f"excite: {verdict.summary()}", file=sys.stderr)
        raise
    for item in report.motions:
        if item.cleared.reason is not None:
            print(f"excite: written all the same: {item.cleared.verdict.summary()}", file=sys.stderr)
    document = report.to_json()
    if out is not None:
        write_json(document, out / "export.json")
    emit_result(
        "\n".join(f"wrote {item.path}" for item in report.motions),
        document,
        as_json=as_json,
        then="run them, record, and "
        + command_line(
            "convert",
            "RECORDING",
            "--robot",
            robot or robot_beside(motion_paths(motions)[0], report.motions[0].robot),
            "--out",
            "log",
        ),
    )


def _parse_settings(texts: list[str]) -> dict[str, str]:
    """Settings from texts ``NAME=VALUE``, each once."""
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name.strip() or name.strip() in found:
            raise typer.BadParameter(f"{text!r} is no NAME=VALUE, or stands twice", param_hint="'--set'")
        found[name.strip()] = value
    return found
