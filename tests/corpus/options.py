"""Numbers and words that no option may take; every command says so in seconds and writes nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from excite.motion.collection import library_folder
from tests.corpus.arm import MJCF
from tests.corpus.case import Case
from tests.corpus.practice import c3d, person, write_log
from tests.robot.small import ARM

_ODD = ("nan", "inf", "-inf", "-1", "1e300", str(10**30))
_NOT_POSITIVE = ("0", *_ODD)
_WHOLE = ("nan", "0", "-3", "1.5", "1e3", str(10**12), str(10**30), "9" * 5000)


def _plan(*words: str) -> Callable[[Path], list[str]]:
    return lambda folder: ["plan", "ur10", *words, "--out", str(folder / "made")]


def _campaign(*words: str) -> Callable[[Path], list[str]]:
    return lambda folder: ["campaign", "ur10", *words, "--out", str(folder / "made")]


def _motion() -> str:
    return str(sorted(library_folder("ur10").glob("motions/*.parquet"))[0])


def _simulate(*words: str) -> Callable[[Path], list[str]]:
    return lambda folder: ["simulate", "ur10", _motion(), *words, "--out", str(folder / "made")]


def _export(*words: str) -> Callable[[Path], list[str]]:
    return lambda folder: ["export", _motion(), "--format", "csv", *words, "--out", str(folder / "made")]


def _identify(*words: str) -> Callable[[Path], list[str]]:
    return lambda folder: [*write_log(folder), *words, "--out", str(folder / "made")]


def _template(content: bytes) -> Callable[[Path], list[str]]:
    def build(folder: Path) -> list[str]:
        (folder / "template.xml").write_bytes(content)
        return [*write_log(folder), "--template", str(folder / "template.xml"), "--out", str(folder / "made")]

    return build


def _diagnose(*words: str) -> Callable[[Path], list[str]]:
    def build(folder: Path) -> list[str]:
        write_log(folder)
        return ["diagnose", str(folder), *words]

    return build


def _person(*words: str) -> Callable[[Path], list[str]]:
    return lambda folder: [*person(c3d(folder)), *words]


def _bounds(text: str) -> Callable[[Path], list[str]]:
    """``identify`` with a file of bounds."""

    def build(folder: Path) -> list[str]:
        (folder / "bounds.yaml").write_text(text)
        return [*write_log(folder), "--method", "physical", "--bounds", str(folder / "bounds.yaml")]

    return build


def _each(
    option: str, values: Sequence[str], build: Callable[..., Callable[[Path], list[str]]], line: str
) -> tuple[tuple[str, Callable[[Path], list[str]], str], ...]:
    return tuple((f"{option} {value[:40]}", build(f"{option}={value}"), line) for value in values)


_SCHEMA = "schema: excite.physical_bounds/1\n"
_ENTITIES = b'<!DOCTYPE m [<!ENTITY a "x">]><mujoco model="&a;"/>'

_FAMILIES = (
    (
        "plan",
        (
            *_each("--candidates", _WHOLE, _plan, "candidates"),
            *_each("--seed", ("nan", "-1", "1.5", str(10**30), "x"), _plan, "seed"),
            ("--budget nan", _plan("--select", "rsd", "--budget", "nan"), "budget: is nan"),
            ("--budget 0", _plan("--select", "rsd", "--budget", "0"), "budget: is 0"),
            ("--budget 1e300", _plan("--select", "rsd", "--budget", "1e300"), r"budget: is 1e\+300"),
            ("--budget of best_three", _plan("--budget", "60"), "budget"),
            ("--select magic", _plan("--select", "magic"), "magic"),
            ("--generator magic", _plan("--generator", "magic"), "magic"),
            ("--joint magic", _plan("--joint", "magic"), "magic"),
        ),
    ),
    (
        "campaign",
        (
            *_each("--candidates", _WHOLE, _campaign, "candidates"),
            *_each("--target-rsd", _NOT_POSITIVE, _campaign, "target.rsd"),
            *_each("--max-iterations", _WHOLE, _campaign, "max.iterations"),
            *_each("--seed", ("-1", str(10**30)), _campaign, "seed"),
            ("--method magic", _campaign("--method", "magic"), "unknown method 'magic'"),
        ),
    ),
    (
        "simulate",
        (
            *_each("--seed", ("-1", str(10**30)), _simulate, "seed"),
            ("--inject magic", _simulate("--inject", "magic"), "unknown effect 'magic'"),
            ("--inject nothing", _simulate("--inject", ""), "unknown effect"),
            ("--inject nowhere", _simulate("--inject", "viscous_friction:nowhere:1"), "nowhere"),
            ("--inject four parts", _simulate("--inject", "payload:a:b:c"), "too many parts"),
            *_each(
                "--inject",
                tuple(f"viscous_friction:elbow_joint:{value}" for value in ("nan", "inf", "-5", "1e300", "x")),
                _simulate,
                "viscous_friction",
            ),
        ),
    ),
    (
        "export",
        (
            *_each("--rate", (*_NOT_POSITIVE, "1e12", "999999"), _export, "rate"),
            ("--format magic", lambda folder: ["export", _motion(), "--format", "magic"], "unknown format 'magic'"),
        ),
    ),
    (
        "identify",
        (
            *_each("--cutoff", _NOT_POSITIVE, _identify, "cutoff"),
            *_each("--total-mass", _NOT_POSITIVE, _identify, "total.mass"),
            ("--method magic", _identify("--method", "magic"), "unknown method 'magic'"),
            ("--mass-range nan", _identify("--method=hqp", "--mass-range=nan"), "mass-range"),
            ("--mass-range 1e300", _identify("--method=hqp", "--mass-range=1e300"), "mass_range"),
            ("--mass-range of a link", _identify("--method=hqp", "--mass-range=fore=1e300"), "mass_range.fore"),
            ("--mass-range of ls", _identify("--method=ls", "--mass-range=0.1"), "not used by method 'ls'"),
            ("--asymmetric magic", _identify("--method=hqp", "--asymmetric=magic"), "magic"),
            ("--cutoff at half the rate", _identify("--cutoff=50"), "cutoff_hz: is 50 Hz, and rows at 100 Hz"),
            ("--cutoff beyond it", _identify("--cutoff=80"), "cutoff_hz: is 80 Hz, and rows at 100 Hz"),
            ("--template of a folder", _identify("--template", "/"), "is no file"),
            ("--template of bytes", _template(bytes(range(256))), "is not valid XML"),
            ("--template empty", _template(b""), "is not valid XML"),
            ("--template with entities", _template(_ENTITIES), "declares XML entities"),
            ("--template of a URDF", _template(ARM.encode()), "is no MuJoCo model"),
            ("--template of another robot", _template(MJCF.encode()), "does not move with joint"),
        ),
    ),
    (
        "bounds",
        (
            ("empty", _bounds(""), "is not a mapping"),
            ("other schema", _bounds("schema: other\n"), "schema"),
            ("key twice", _bounds(_SCHEMA + _SCHEMA), "stands twice"),
            ("nothing bounded", _bounds(_SCHEMA), "bounds nothing"),
            ("nan", _bounds(_SCHEMA + "total_mass: [.nan, 5.0]\n"), r"total_mass.*\.nan"),
            ("inf below", _bounds(_SCHEMA + "total_mass: [.inf, .inf]\n"), "total_mass"),
            ("turned", _bounds(_SCHEMA + "total_mass: [5.0, 1.0]\n"), "total_mass"),
            ("words", _bounds(_SCHEMA + "total_mass: heavy\n"), "total_mass"),
            ("unknown link", _bounds(_SCHEMA + "links: {tail: {m: [1.0, 2.0]}}\n"), "tail"),
            ("links as a list", _bounds(_SCHEMA + "links: [1, 2]\n"), "links"),
            ("link as a number", _bounds(_SCHEMA + "links: {fore: 3}\n"), "fore"),
            ("unknown field", _bounds(_SCHEMA + "limbs: {}\n"), "limbs"),
            ("rules as a word", _bounds(_SCHEMA + "total_mass: [1.0, 5.0]\nrules: some\n"), "rules"),
            ("drives as a number", _bounds(_SCHEMA + "drives: 5\n"), "drives"),
        ),
    ),
    ("diagnose", _each("--seed", ("nan", "-1", str(10**30)), _diagnose, "seed")),
    (
        "human",
        (
            *_each("--mass", (*_NOT_POSITIVE, "70000", "x"), _person, "mass"),
            *_each("--height", (*_NOT_POSITIVE, "175", "x"), _person, "height"),
            *_each("--cutoff", (*_ODD, "1e-9"), _person, "cutoff"),
            *_each("--hold-out", (*_ODD, "0.95"), _person, "hold.out"),
            *_each("--segment-mass", ("left_shank=nan", "left_shank=1e300", "tail=1", "5"), _person, "segment"),
            ("--sex magic", _person("--sex", "magic"), "magic"),
            ("--table magic", _person("--table", "magic"), "table of segment inertias 'magic'"),
            ("--up w", _person("--up", "w"), "axis that points up 'w'"),
            ("--markers magic", _person("--markers", "magic"), "marker set .* 'magic'"),
        ),
    ),
)  # fmt: skip

CASES: tuple[Case, ...] = tuple(
    Case(f"option: {family}", name, build, line) for family, cases in _FAMILIES for name, build, line in cases
)
