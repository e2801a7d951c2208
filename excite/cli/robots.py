"""The commands ``robots``, ``init-robot``, ``check``, ``model`` and ``schema``: robots, and files about them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import excite
from excite.cli.options import (
    ModelOutOption,
    command,
    one_of,
    requested_workers,
    stated_source,
)
from excite.cli.output import (
    EXIT_NEGATIVE,
    command_line,
    emit_result,
    print_document,
    progress_bars,
    relative_to,
    stated_origin,
    write_and_emit,
)
from excite.display import count
from excite.export.simulators.registry import MODEL_FORMATS
from excite.results import write_json

if TYPE_CHECKING:
    from excite.export.simulators.model_format import Lost
    from excite.export.simulators.subject_result import Change
    from excite.export.simulators.write import SimulatorModel


@command("robots")
def list_robots(
    *,
    as_json: bool,
    out: Path | None,
) -> None:
    """List the bundled robots: degrees of freedom, mass, sensors, base type."""
    summaries = excite.robot_summaries()
    document = {"schema": "excite.robots/1", "robots": [summary.to_json() for summary in summaries]}
    if write_and_emit(document, "robots.json", as_json=as_json, out=out):
        return
    from rich.console import Console
    from rich.table import Table

    table = Table("robot", "title", "base", "DoF", "mass [kg]", "sensors", box=None, pad_edge=False)
    for summary in summaries:
        table.add_row(
            summary.name,
            summary.title,
            summary.base,
            str(summary.n_joints),
            f"{summary.mass:.1f}",
            ", ".join(summary.sensors),
        )
    Console(soft_wrap=True).print(table)
    print(f"then: {command_line('plan', 'ROBOT', '--out', 'plan')}")


@command("init-robot")
def write_description(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="URDF or xacro of the robot, or its MuJoCo model (MJCF).")
    ],
    srdf: Annotated[
        Path | None, typer.Option("--srdf", help="Pairs of links that may touch, from MoveIt's file.")
    ] = None,
    package_path: list[Path] | None = None,
    xacro_arg: list[str] | None = None,
    limits: Path | None = None,
    force: Annotated[
        bool, typer.Option("--force", help="Overwrite a robot.yaml that is there already.")
    ] = False,
    *,
    out: Path | None,
    as_json: bool,
    seed: int,
) -> None:
    """Write a complete robot.yaml: what the model says, and what had to be assumed, with its consequence.

    Of a MuJoCo model or xacro file the URDF is written too.
    """
    from excite.robot.inspection.chart import examine_description  # lazy: pinocchio

    source = replace(stated_source(package_path, xacro_arg, limits), srdf=srdf)
    written = excite.write_scaffold(file, out or file.parent, seed=seed, overwrite=force, source=source)
    chart = examine_description(written.description)
    document = {
        "schema": "excite.init-robot/1",
        "file": "robot.yaml" if out else str(written.description),
        "fill_in": [],
        "assumed": [one.to_json() for one in written.assumed],
        "urdf": str(written.urdf) if not out else written.urdf.name,
        "notes": list(written.notes),
        "findings": [finding.to_json() for finding in chart.findings],
    }
    lines = [f"wrote {written.description}"]
    if written.urdf != file:
        lines.append(f"wrote {written.urdf}")
    lines += [f"  note: {note}" for note in written.notes]
    lines += [f"  assumed: {one}" for one in written.assumed]
    if chart.findings:
        lines += ["the model itself:", *(f"  {line}" for line in chart.summary().splitlines())]
    emit_result("\n".join(lines), document, as_json=as_json, then=command_line("plan", written.description))


@command("check")
def check_motions(
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="ROBOT MOTION…",
            help="Robot (a bundled one or a path to its robot.yaml); then motions: files of any format that export "
            "writes, tables with a time and a column a joint, or folders of them.",
        ),
    ],
    whose: Annotated[
        str | None,
        typer.Option("--robot", metavar="ROBOT", help="The robot; all arguments are motions then."),
    ] = None,
    robust: Annotated[
        bool,
        typer.Option(
            "--robust",
            help="Call a motion safe only if it is so for every robot within the uncertainty that robot.yaml states "
            "(mass ± 10 %, centre of mass ± 1 cm, inertia ± 20 % of each body if it states none).",
        ),
    ] = False,
    *,
    out: Path | None,
    as_json: bool,
    jobs: int | None,
    cluster: str | None,
) -> None:
    """Check motions independently: verdict, margins, first violation with time and place."""
    robot, motions = (files[0], files[1:]) if whose is None else (whose, files)
    if not motions:
        raise typer.BadParameter("name at least one", param_hint="'MOTION…'")
    from excite.motion.collection import motion_paths  # lazy: pinocchio
    from excite.robot.inspection.chart import examine_model  # lazy: pinocchio

    loaded = excite.load_robot(robot)
    with requested_workers(jobs, cluster) as crew, progress_bars() as progress:
        result = excite.check(
            loaded, excite.load_motions(motions, loaded), robust=robust, jobs=crew, progress=progress
        )
    chart = examine_model(loaded)
    result = replace(result, findings=tuple(chart.spoiling))
    if out is not None:
        paths = zip(result.verdicts, motion_paths(motions), strict=True)
        verdicts = tuple(replace(one, file=relative_to(out, path)) for one, path in paths)
        result = replace(result, verdicts=verdicts, **stated_origin(robot, None, out))
        write_json(result.to_json(), out / "check.json")
    then = command_line("rank", robot, *motions) if result.safe else ""
    said = "\n".join(filter(None, (chart.worst_in_words(), result.summary())))
    emit_result(said, result.to_json(), as_json=as_json, then=then)
    if not result.safe:
        raise typer.Exit(EXIT_NEGATIVE)


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
    as_json: bool,
) -> None:
    """Write the identified robot for a simulator, with proof that each parameter arrives, and what is lost."""
    written = excite.write_simulator_model(result, format_name, out, robot=robot, template=template)
    main = written.folder / written.files[0]
    emit_result(
        "" if as_json else _describe_written(written),
        written.to_json(),
        as_json=as_json,
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
        f"read again: {proof.felt} parameters were changed one by one and the torques followed each"
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


@command("schema")
def print_schema(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help="log, robot, bounds, map, motion; results, all of them, or one: blind, blind_answer, campaign, check, "
            "diagnosis, doctor, export, human, identification, journal, model, plan, rank, refusals, "
            "signals, simulation, truth.",
        ),
    ],
) -> None:
    """Print the JSON schema of a file that is written by hand or by excite."""
    print_document(excite.file_schema(name))
