"""The commands ``export``, ``model``, ``report`` and ``view``: results for controllers, simulators and people."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import excite
from excite.cli.options import (
    Call,
    ModelOutOption,
    command,
    one_of,
)
from excite.cli.output import command_line
from excite.display import count
from excite.export.registry import EXPORTERS, MODEL_FORMATS

if TYPE_CHECKING:
    from excite.export.models.model_format import Lost
    from excite.export.models.simulator_model import SimulatorModel
    from excite.export.models.subject import Change

# Rows of the table on a terminal; changes.csv has all of them.
_MODEL_ROWS = 40
# Least width of that table [characters].
_MODEL_WIDTH = 110
# Smaller changes are no news [percent].
_NEWS = 0.1
# Order of what is shown, by the first letters of a parameter; what is not here comes first.
_RANK = {"com": 1, **dict.fromkeys(("Ixx", "Iyy", "Izz"), 2), **dict.fromkeys(("Ixy", "Ixz", "Iyz"), 3)}


@command("model")
def write_model(
    result: Annotated[
        Path,
        typer.Argument(
            metavar="RESULT",
            help="What `excite identify`, `campaign` or `diagnose --apply` wrote: the folder, or the JSON in it.",
        ),
    ],
    format_name: Annotated[
        str,
        typer.Option(
            "--format",
            help=f"One of {', '.join(MODEL_FORMATS)} (docs/simulators.md: what each holds, in which units).",
            autocompletion=one_of(MODEL_FORMATS),
        ),
    ],
    out: ModelOutOption,
    robot: Annotated[
        str | None,
        typer.Option(
            "--robot",
            metavar="ROBOT",
            help="The robot that it was identified with, where the result does not say: bundled, or a file.",
        ),
    ] = None,
    template: Annotated[
        Path | None,
        typer.Option(
            "--template", metavar="FILE", help="MuJoCo model of the robot, whose text mjcf and mjlab keep."
        ),
    ] = None,
    *,
    call: Call,
) -> None:
    """Write the identified robot for a simulator, with proof that each parameter arrives, and what is lost."""
    written = excite.write_simulator_model(result, format_name, out, robot=robot, template=template)
    main = written.folder / written.files[0]
    call.emit_result(
        "" if call.as_json else _describe_written(written),
        written.to_json(),
        then=f"open {main} in your simulator; {written.folder / 'changes.csv'} has all that changed",
    )


def _describe_written(written: SimulatorModel) -> str:
    from rich.console import Console
    from rich.table import Table

    # Names of joints are not cut: a line that is too long for a terminal is wrapped by it.
    console = Console(highlight=False, width=max(Console().width, _MODEL_WIDTH))
    shown = _shown_changes(written.changes)
    table = Table(
        "where", "parameter", *(f"{name}" for name in ("before", "after", "change", "unit")), box=None
    )
    for row in shown:
        table.add_row(
            row.place,
            row.parameter,
            f"{row.before:.4g}",
            f"{row.after:.4g}",
            f"{row.change:+.3g}{_relative_change(row)}",
            row.unit,
        )
    with console.capture() as capture:
        console.print(table)
    lines = [capture.get().rstrip()] if shown else []
    rest = sum(row.change != 0.0 for row in written.changes) - len(shown)
    if rest > 0:
        lines.append(f"and {count(rest, 'smaller change')}, in {written.folder / 'changes.csv'}")
    proof = written.proof
    lines += [f"wrote {written.folder / name}" for name in written.files]
    lines.append(
        f"read again: {proof.felt} parameters are as they were found, and so are the torques"
        + (f"; on {len(proof.unseen)} no torque depends" if proof.unseen else "")
    )
    lines += _describe_lost(written.lost)
    lines += [f"note: {text}" for text in written.notes]
    return "\n".join(lines)


def _shown_changes(changes: tuple[Change, ...]) -> list[Change]:
    """The rows that a person looks for first, in the model's order: masses and joints, then centres of mass."""
    news = [row for row in changes if 100.0 * abs(row.change) > _NEWS * _change_scale(row, changes)]
    kept = sorted(range(len(news)), key=lambda index: (_RANK.get(news[index].parameter[:3], 0), index))[
        :_MODEL_ROWS
    ]
    return [news[index] for index in sorted(kept)]


def _relative_change(row: Change) -> str:
    """The change in per cent; one that is larger than what was there is told by what was and is."""
    return "" if row.percent is None or abs(row.percent) > 100.0 else f" ({row.percent:+.1f} %)"


def _change_scale(row: Change, changes: tuple[Change, ...]) -> float:
    """What a change is seen beside: what was before, or where that was zero the body's other centres or inertias."""
    kind = next((kind for kind in ("com_", "I") if row.parameter.startswith(kind)), row.parameter)
    alike = (other for other in changes if other.place == row.place and other.parameter.startswith(kind))
    return abs(row.before) or max((abs(other.before) for other in alike), default=0.0)


def _describe_lost(lost: tuple[Lost, ...]) -> list[str]:
    """What is lost, a line for all places of a parameter together."""
    places: dict[tuple[str, str], list[str]] = {}
    for item in lost:
        value = "" if item.value is None else f" {item.value:.3g}"
        places.setdefault((item.parameter, item.why), []).append(f"{item.where}{value}")
    return [f"lost: {parameter} ({', '.join(where)}): {why}" for (parameter, why), where in places.items()]


@command("export")
def export_motions(
    motions: list[Path],
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
    *,
    call: Call,
) -> None:
    """Write motions in the format of a controller, if the independent check finds all of them safe."""
    from excite.export.export import export_with_verdicts, robot_beside  # lazy: pinocchio
    from excite.motion.collection import motion_paths  # lazy: pinocchio

    try:
        report = export_with_verdicts(
            motions,
            format_name,
            out=call.out or Path(),
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
    call.write_document(document, "export.json")
    call.emit_result(
        "\n".join(f"wrote {item.path}" for item in report.motions),
        document,
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


@command("report")
def write_report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that another command wrote.")],
    *,
    call: Call,
) -> None:
    """Write report.html from what a folder holds."""
    path = excite.report(folder, out=call.out)
    document = {"schema": "excite.report/1", "file": str(path.relative_to(call.out) if call.out else path)}
    call.emit_result(f"wrote {path}", document, then="open it in a browser")


@command("view")
def view_motions(
    thing: Annotated[
        Path,
        typer.Argument(
            metavar="THING", help="A motion file, or the folder of motions, a plan, a log or a diagnosis."
        ),
    ],
    robot: Annotated[
        str | None,
        typer.Option(
            "--robot", metavar="ROBOT", help="The robot, where the files do not say or it lies elsewhere."
        ),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(
            "--record",
            metavar="FILE.html",
            help="Write it as a page that needs no network, and serve nothing; in --out where that is given.",
        ),
    ] = None,
    port: Annotated[int, typer.Option("--port", min=1, max=65535, help="Port to serve at.")] = 8080,
    *,
    call: Call,
) -> None:
    """Watch it move, with the signals of a joint and its residuals beside it."""
    from excite.report.view import read_thing, record_page, serve  # lazy: pinocchio

    shown = read_thing(thing, robot)
    if record is not None:
        path = record_page(shown, record if call.out is None else call.out / record)
        document = {"schema": "excite.view/1", "file": str(record), "motions": len(shown.clips)}
        call.emit_result(f"wrote {path}", document, then="open it in a browser")
        return

    def ready(address: str) -> None:
        document = {"schema": "excite.view/1", "address": address, "motions": len(shown.clips)}
        call.emit_result(f"{shown.title}\nopen {address} in a browser; Ctrl-C ends it", document)

    serve(shown, port, ready)
