"""``excite model``: the identified robot for a simulator."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import excite
from excite.cli.session.options import JobsOption, JsonOption, ModelOutOption, SeedOption, one_of
from excite.cli.session.output import emit_result
from excite.display import count
from excite.export.registry import MODEL_FORMATS

if TYPE_CHECKING:
    from excite.export.models.model_format import Lost
    from excite.export.models.simulator_model import SimulatorModel
    from excite.export.models.subject import Change

NAME = "model"
# Rows of the table on a terminal; changes.csv has all of them.
_ROWS = 40
# Least width of that table [characters].
_WIDTH = 110
# Smaller changes are no news [percent].
_NEWS = 0.1
# Order of what is shown, by the first letters of a parameter; what is not here comes first.
_RANK = {"com": 1, **dict.fromkeys(("Ixx", "Iyy", "Izz"), 2), **dict.fromkeys(("Ixy", "Ixz", "Iyz"), 3)}


def command(
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
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
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
    console = Console(highlight=False, width=max(Console().width, _WIDTH))
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
        :_ROWS
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
