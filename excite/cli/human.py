"""``excite human``: a person's model and log folder from markers and force plates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import excite
from excite.atomic import atomic_folder
from excite.cli.session.options import (
    AsymmetricOption,
    JobsOption,
    JsonOption,
    MassRangeOption,
    SeedOption,
    named_numbers,
    segment_settings,
)
from excite.cli.session.output import command_line, emit_result, progress_bars
from excite.errors import InputError
from excite.identification.estimators.registry import find_estimator
from excite.results import write_json

if TYPE_CHECKING:
    from excite.identification.estimators.settings import EstimatorSettings

NAME = "human"
_DOCUMENT = "human.json"


def command(
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
    asymmetric: AsymmetricOption = None,
    mass_range: MassRangeOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
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
        person, summary = _evaluate_person(person, folder, loaded, identify, estimator)
        files = sorted([_DOCUMENT, *(item.name for item in folder.iterdir())])
        document = replace(person, files=tuple(files)).to_json()
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
    from excite.documents.document import model_of, read_document  # lazy: pydantic
    from excite.human.measure import MeasuredPerson  # lazy: pinocchio

    try:
        return list(read_document(out / _DOCUMENT, model_of(MeasuredPerson)).content()["files"])
    except InputError:  # what it named cannot be told: all is kept
        return []


def _evaluate_person(
    person: excite.MeasuredPerson,
    folder: Path,
    loaded: int,
    identify: str | None,
    estimator: EstimatorSettings | None,
) -> tuple[excite.MeasuredPerson, str]:
    """The person with all that was asked for, which was written beside the log, and what is said of it."""
    said = []
    weight = excite.added_mass(folder, loaded) if loaded else None
    if weight is not None:
        person = replace(person, added_mass=weight)
        said.append(f"\n{weight.summary()}")
    if identify is not None:
        found = excite.identify_person(person, folder, identify, estimator, loaded=loaded)
        person = replace(
            person, identification=found.identification, ground_reaction=found.reaction_table.fits
        )
        said.append(f"\n\n{found.summary()}")
        worn = None
        if weight is not None:
            worn = excite.identify_wearing(person, folder, weight, found, loaded, identify, estimator)
            person = replace(person, worn_weight=worn)
            said.append(f"\n\n{worn.summary()}")
        from excite.report.person_figures import save_person_figures  # lazy: pinocchio

        save_person_figures(found, None if worn is None else worn.wearing, person.body.table, folder)
    return person, "".join(said)
