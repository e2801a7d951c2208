"""What is known of single segments, as options: symmetry that does not hold, ranges of masses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

import excite
from excite.errors import InputError

if TYPE_CHECKING:
    from excite.identification.estimators.settings import EstimatorSettings

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
