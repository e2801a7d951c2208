"""The commands ``export``, ``human``, ``report`` and ``view``: results for controllers, and for people to look at."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import excite
from excite.atomic import atomic_folder
from excite.cli.options import (
    command,
    named_numbers,
    one_of,
    segment_settings,
)
from excite.cli.output import command_line, emit_result, progress_bars
from excite.errors import InputError
from excite.export.registry import EXPORTERS
from excite.identification.estimators.registry import find_estimator
from excite.results import write_json

if TYPE_CHECKING:
    from excite.identification.estimators.settings import EstimatorSettings


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
    out: Path | None,
    as_json: bool,
) -> None:
    """Write motions in the format of a controller, if the independent check finds all of them safe."""
    from excite.export.export import SCHEMA, export_with_verdicts  # lazy: pinocchio
    from excite.export.resolve_robot import robot_beside  # lazy: pydantic
    from excite.motion.collection import motion_paths  # lazy: pinocchio

    try:
        written = export_with_verdicts(
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
    for item in written:
        if item.cleared.reason is not None:
            print(f"excite: written all the same: {item.cleared.verdict.summary()}", file=sys.stderr)
    entries = [item.to_json(out) for item in written]
    document = {
        "schema": SCHEMA,
        "format": format_name,
        "files": [entry["file"] for entry in entries],
        "motions": entries,
    }
    if out is not None:
        write_json(document, out / "export.json")
    emit_result(
        "\n".join(f"wrote {item.path}" for item in written),
        document,
        as_json=as_json,
        then="run them, record, and "
        + command_line(
            "convert",
            "RECORDING",
            "--robot",
            robot or robot_beside(motion_paths(motions)[0], written[0].cleared.motion.robot),
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


_DOCUMENT = "human.json"


@command("human")
def measure_person(
    trials: Annotated[
        list[Path],
        typer.Argument(
            metavar="TRIAL…", help="Recordings: C3D or CSV, or TRC with MOT/STO (markers with their forces)."
        ),
    ],
    mass: Annotated[float, typer.Option("--mass", help="Mass of the person with all that is worn [kg].")],
    height: Annotated[float, typer.Option("--height", help="Stature [m].")],
    sex: Annotated[str, typer.Option("--sex", help="male or female: which tables are taken.")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Log folder that is written.")] = Path(
        "human_log"
    ),
    static: Annotated[
        list[Path] | None,
        typer.Option("--static", help="Recording of standing, for calibration only (may be repeated)."),
    ] = None,
    table: Annotated[
        str, typer.Option("--table", help="Nominal segment inertias: de_leva (1996) or dumas (2007).")
    ] = "de_leva",
    markers: Annotated[
        str | None,
        typer.Option("--markers", help="Marker set (jovic, plug_in_gait, rajagopal) or mapping file."),
    ] = None,
    up: Annotated[
        str | None,
        typer.Option("--up", help="Laboratory axis that points up: x, y or z; found if not given."),
    ] = None,
    cutoff_hz: Annotated[
        float,
        typer.Option(
            "--cutoff", min=0.0, help="Low-pass on markers and forces [Hz], third order; 0 for none."
        ),
    ] = 6.0,
    hold_out: Annotated[
        float,
        typer.Option("--hold-out", min=0.0, max=0.9, help="Share of a single trial kept for validation."),
    ] = 0.3,
    identify: Annotated[
        str | None,
        typer.Option(
            "--identify",
            metavar="METHOD",
            help="Identify at once by a method below (lmi, hqp): table of segment masses, URDF, OpenSim model.",
        ),
    ] = None,
    loaded: Annotated[
        int,
        typer.Option(
            "--loaded", min=0, help="How many of the last trials were done wearing a weight: find it."
        ),
    ] = 0,
    segment_mass: Annotated[
        list[str] | None,
        typer.Option(
            "--segment-mass",
            metavar="SEGMENT=KG",
            help="Nominal mass of a segment that is no table's, of a prosthesis or a stump (may be repeated).",
        ),
    ] = None,
    asymmetric: list[str] | None = None,
    mass_range: list[str] | None = None,
    *,
    as_json: bool,
) -> None:
    """Make a person's model (15 segments, 34 joints) and a log folder; then `excite identify DIR/robot.yaml DIR`."""
    if identify is None and (asymmetric or mass_range):
        option = "--asymmetric" if asymmetric else "--mass-range"
        raise InputError("identifies nothing", field=option, remedy="add --identify hqp")
    estimator = None if identify is None else segment_settings(identify, asymmetric, mass_range)
    settings = excite.MeasureSettings(
        table=table,
        markers=markers,
        up=up,
        cutoff_hz=cutoff_hz,
        hold_out=hold_out,
        segment_mass=named_numbers("--segment-mass", segment_mass),
    )
    subject = excite.Subject(mass, height, sex)
    _check_whole(trials, loaded, identify, out)
    written_before = _written_files(out)
    with progress_bars() as progress:
        person = excite.measure_person(subject, trials, tuple(static or ()), settings, progress)
    from excite.logs.files import keep_others  # lazy: pinocchio

    # All of it or nothing: a folder without what was asked for would be taken for the whole.
    with atomic_folder(out) as folder:
        excite.write_person(person, folder)
        document, summary = _evaluate_person(person, folder, loaded, identify, estimator)
        document["files"] = sorted([_DOCUMENT, *(item.name for item in folder.iterdir())])
        write_json(document, folder / _DOCUMENT)
        keep_others(out, folder, written_before)
    # Of a log with trials that were done with a weight, the body is not to be identified as if there were none.
    plain = identify is None and not loaded
    then = command_line("identify", out / "robot.yaml", out, "--out", "segments") if plain else ""
    emit_result(
        f"{person.summary()}\nwrote {out}{summary}",
        document,
        as_json=as_json,
        then=then or ("" if identify is None else command_line("report", out)),
    )


def _check_whole(trials: list[Path], loaded: int, identify: str | None, out: Path) -> None:
    """Say before the work is done that it could not be finished."""
    if loaded >= len(trials):
        from excite.formats.number import shorten_value  # lazy: numpy

        raise InputError(
            f"is {shorten_value(loaded)} of {len(trials)} recordings",
            field="--loaded",
            remedy="give a recording without the weight too, before those with it",
        )
    from excite.logs.files import check_replaceable  # lazy: pinocchio

    if identify is not None:
        find_estimator(identify)
    check_replaceable(out)


def _written_files(out: Path) -> list[str]:
    """Names of the files that an earlier run wrote into the folder, which this one replaces."""
    if not (out / _DOCUMENT).is_file():
        return []
    from excite.documents.document import read_document  # lazy: pydantic
    from excite.documents.results import Human  # lazy: pydantic

    try:
        return read_document(out / _DOCUMENT, Human).files
    except InputError:  # what it named cannot be told: all is kept
        return []


def _evaluate_person(
    person: excite.MeasuredPerson,
    folder: Path,
    loaded: int,
    identify: str | None,
    estimator: EstimatorSettings | None,
) -> tuple[dict[str, Any], str]:
    """The document and what is said of it, after all that was asked for was written beside the log."""
    document, said = person.to_json(), []
    weight = excite.added_mass(folder, loaded) if loaded else None
    if weight is not None:
        document["added_mass"] = weight.to_json()
        said.append(f"\n{weight.summary()}")
    if identify is not None:
        found = excite.identify_person(person, folder, identify, estimator, loaded=loaded)
        document["identification"] = found.identification.to_json()
        document["ground_reaction"] = found.reaction_table.to_json()
        said.append(f"\n\n{found.summary()}")
        worn = None
        if weight is not None:
            worn = excite.identify_wearing(person, folder, weight, found, loaded, identify, estimator)
            document["worn_weight"] = worn.to_json()
            said.append(f"\n\n{worn.summary()}")
        from excite.report.person_figures import save_person_figures  # lazy: pinocchio

        save_person_figures(found, None if worn is None else worn.wearing, person.body.table, folder)
    return document, "".join(said)


@command("report")
def write_report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that another command wrote.")],
    *,
    out: Path | None,
    as_json: bool,
) -> None:
    """Write report.html from what a folder holds."""
    path = excite.report(folder, out=out)
    document = {"schema": "excite.report/1", "file": str(path.relative_to(out) if out else path)}
    emit_result(f"wrote {path}", document, as_json=as_json, then="open it in a browser")


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
    out: Path | None,
    as_json: bool,
) -> None:
    """Watch it move, with the signals of a joint and its residuals beside it."""
    from excite.report.view import read_thing, record_page, serve  # lazy: pinocchio

    shown = read_thing(thing, robot)
    if record is not None:
        path = record_page(shown, record if out is None else out / record)
        document = {"schema": "excite.view/1", "file": str(record), "motions": len(shown.clips)}
        emit_result(f"wrote {path}", document, as_json=as_json, then="open it in a browser")
        return

    def ready(address: str) -> None:
        document = {"schema": "excite.view/1", "address": address, "motions": len(shown.clips)}
        emit_result(f"{shown.title}\nopen {address} in a browser; Ctrl-C ends it", document, as_json=as_json)

    serve(shown, port, ready)
