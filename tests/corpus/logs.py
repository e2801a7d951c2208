"""Log folders that no command may take: headers, trial files, numbers and clocks."""

from __future__ import annotations

import os
import struct
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import yaml

from tests.corpus.case import Case
from tests.corpus.practice import ROWS, arguments, columns, first_trial, header, write_log

_CLOCK = np.arange(ROWS) / 100.0


def _stated(**fields: Any) -> Callable[[Path], list[str]]:
    """A log whose header says something else, or nothing where a field is None."""

    def build(folder: Path) -> list[str]:
        stated = {name: value for name, value in (header() | fields).items() if value is not None}
        write_log(folder)
        return _rewritten(folder, stated)

    return build


def _rewritten(folder: Path, stated: dict[str, Any]) -> list[str]:
    (folder / "log.yaml").write_text(yaml.safe_dump(stated, sort_keys=False, allow_unicode=True))
    return arguments(folder)


def _trial(**fields: Any) -> Callable[[Path], list[str]]:
    """A log whose second trial is listed otherwise."""
    return _stated(trials=[header()["trials"][0], {**header()["trials"][1], **fields}])


def _text(text: str | bytes) -> Callable[[Path], list[str]]:
    def build(folder: Path) -> list[str]:
        write_log(folder)
        content = text if isinstance(text, bytes) else text.encode()
        (folder / "log.yaml").write_bytes(content)
        return arguments(folder)

    return build


def _spoilt(**changed: Any) -> Callable[[Path], list[str]]:
    """A log in whose first trial columns are replaced; ``__`` stands for a dot."""

    def build(folder: Path) -> list[str]:
        return write_log(folder, None, {name.replace("__", "."): v for name, v in changed.items()})

    return build


def _all(**changed: Any) -> Callable[[Path], list[str]]:
    """A log in whose trials columns are replaced."""

    def build(folder: Path) -> list[str]:
        made = write_log(folder, None, changed)
        (folder / "two.csv").write_bytes((folder / "one.csv").read_bytes())
        return made

    return build


def _with(name: str, row: int, value: float) -> Callable[[Path], list[str]]:
    def build(folder: Path) -> list[str]:
        values = columns()[name].copy()
        values[row] = value
        return write_log(folder, None, {name: values})

    return build


def _file(suffix: str, spoil: Callable[[Path], None]) -> Callable[[Path], list[str]]:
    """A sound log whose first trial's file is spoilt."""

    def build(folder: Path) -> list[str]:
        spoil(first_trial(folder, suffix))
        return arguments(folder)

    return build


def _bytes(change: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    def spoil(path: Path) -> None:
        path.write_bytes(change(path.read_bytes()))

    return spoil


def _line(number: int, text: str) -> Callable[[Path], None]:
    def spoil(path: Path) -> None:
        lines = path.read_text().splitlines()
        lines[number] = text
        path.write_text("\n".join(lines) + "\n")

    return spoil


def _parquet(**replaced: Any) -> Callable[[Path], None]:
    def spoil(path: Path) -> None:
        found = columns() | {name.replace("__", "."): values for name, values in replaced.items()}
        pa.parquet.write_table(pa.table({name: pa.array(v) for name, v in found.items()}), path)

    return spoil


def _npz(**replaced: Any) -> Callable[[Path], None]:
    def spoil(path: Path) -> None:
        found = columns() | {name.replace("__", "."): values for name, values in replaced.items()}
        np.savez(path, **found)

    return spoil


def _member(name: str, content: bytes, method: int = zipfile.ZIP_DEFLATED) -> Callable[[Path], None]:
    """Add or double a member of an archive."""

    def spoil(path: Path) -> None:
        with warnings.catch_warnings(), zipfile.ZipFile(path, "a", method) as archive:
            warnings.simplefilter("ignore", UserWarning)
            archive.writestr(name, content)

    return spoil


def _npy(shape: str, kind: str = "<f8", body: bytes = b"") -> bytes:
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode() + body


def _bomb(path: Path) -> None:
    zeros = b"\0" * (1 << 24)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        with archive.open("q.bomb.npy", "w", force_zip64=True) as stream:
            for _ in range(110):
                stream.write(zeros)


def _footer(length: int) -> Callable[[bytes], bytes]:
    return lambda data: data[:-8] + struct.pack("<i", length) + data[-4:]


def _hdf5(change: Callable[[Any, Path], None]) -> Callable[[Path], None]:
    def spoil(path: Path) -> None:
        import h5py

        with h5py.File(path, "r+") as file:
            change(file, path)

    return spoil


def _external(file: Any, path: Path) -> None:
    import h5py

    del file["q.elbow"]
    file["q.elbow"] = h5py.ExternalLink("/etc/other.h5", "q.elbow")


def _soft(file: Any, path: Path) -> None:
    import h5py

    del file["q.elbow"]
    file["q.elbow"] = h5py.SoftLink("/nowhere")


def _virtual(file: Any, path: Path) -> None:
    import h5py

    del file["q.elbow"]
    layout = h5py.VirtualLayout(shape=(ROWS,), dtype="f8")
    layout[:] = h5py.VirtualSource("/etc/other.h5", "q", shape=(ROWS,))
    file.create_virtual_dataset("q.elbow", layout)


def _raw(file: Any, path: Path) -> None:
    del file["q.elbow"]
    file.create_dataset("q.elbow", (ROWS,), dtype="f8", external=[("/etc/passwd", 0, 8 * ROWS)])


def _vast(file: Any, path: Path) -> None:
    del file["q.elbow"]
    file.create_dataset("q.elbow", (10**12,), dtype="f8", chunks=(1000,))


def _compound(file: Any, path: Path) -> None:
    del file["q.elbow"]
    file.create_dataset("q.elbow", data=np.zeros(ROWS, dtype=[("a", "f8"), ("b", "i4")]))


def _pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def _folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def _link(target: str) -> Callable[[Path], None]:
    def spoil(path: Path) -> None:
        path.unlink()
        path.symlink_to(target)

    return spoil


def _robot(spoil: Callable[[Path], None], name: str = "robot.urdf") -> Callable[[Path], list[str]]:
    """``diagnose``, which takes the robot from the log, with its file spoilt."""

    def build(folder: Path) -> list[str]:
        write_log(folder)
        _rewritten(folder, header() | {"robot": name})
        spoil(folder / "robot.urdf")
        return ["diagnose", str(folder)]

    return build


def _nothing(path: Path) -> None:
    """Leave a file as it is."""


_ALIASES = "a: &a [1,1,1,1,1,1,1,1,1,1]\n" + "".join(
    f"{b}: &{b} [{','.join([f'*{a}'] * 10)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
_FOOT = {"name": "f", "kind": "foot_ft", "parent": "fore", "foot": "fore"}


_HEADER = (
    ("empty", _text(""), "is not a mapping"),
    ("list", _text("- 1\n- 2\n"), "is not a mapping"),
    ("no YAML", _text("a: [1, 2\n"), "is not valid YAML"),
    ("no text", _text(b"\xff\xfe\x00\x01schema"), "is no UTF-8 text"),
    ("zero byte", _text(b"schema: a\0b\n"), "is not valid YAML"),
    ("aliases of aliases", _text(_ALIASES), "stands for more than"),
    ("nested", _text("[" * 5000), "nested more than"),
    ("key twice", _text("schema: excite.log/1\nschema: excite.log/1\n"), "stands twice"),
    ("contains itself", _text("a: &a {b: *a}\n"), "contains itself"),
    ("other schema", _stated(schema="excite.log/7"), "schema"),
    ("no schema", _stated(schema=None), "schema"),
    ("unknown field", _stated(rate=100), "rate: extra inputs"),
    ("no joints", _stated(joints=[]), "joints"),
    ("no trials", _stated(trials=[]), "trials"),
    ("python object", _text("!!python/object/apply:os.system ['true']\n"), "is not valid YAML"),
)
_NUMBERS = (
    ("gravity nan", _stated(gravity=[0.0, 0.0, float("nan")]), r"gravity.*\.nan"),
    ("gravity inf", _stated(gravity=[0.0, 0.0, float("-inf")]), "gravity.2"),
    ("gravity in mm/s²", _stated(gravity=[0.0, 0.0, -9810.0]), "gravity.2"),
    ("gravity of two", _stated(gravity=[0.0, -9.81]), "gravity"),
    ("gravity in words", _stated(gravity="down"), "gravity"),
    ("rate zero", _stated(rate_hz=0), "rate_hz"),
    ("rate negative", _stated(rate_hz=-100), "rate_hz"),
    ("rate inf", _stated(rate_hz=float("inf")), "rate_hz"),
    ("rate of GHz", _stated(rate_hz=1e9), "rate_hz"),
    ("rate true", _stated(rate_hz=True), "rate_hz.*no number"),
    ("low-pass negative", _stated(lowpass_hz=-6.0), "lowpass_hz"),
    ("start of inf", _trial(start_s=float("inf")), "start_s"),
    ("start of nanoseconds", _trial(start_s=1.7e18), "start_s"),
    ("torque constant of inf", _stated(torque_constants={"elbow": float("inf")}), "torque_constants.elbow"),
    ("noise negative", _stated(sensors=[{**_FOOT, "noise_force": -1.0}]), "noise_force"),
    ("angles in degrees", _stated(sensors=[{**_FOOT, "rpy": [0, 90, 0]}]), "rpy.1"),
    ("sensor light years away", _stated(sensors=[{**_FOOT, "xyz": [0, 0, 1e300]}]), "xyz.2"),
)
_NAMES = (
    ("joint twice", _stated(joints=["shoulder", "shoulder"]), "'shoulder' stands twice"),
    ("joint without a name", _stated(joints=["shoulder", ""]), "joints.1"),
    ("joint with a line break", _stated(joints=["shoulder", "el\nbow"]), "cannot be printed"),
    ("joint with an escape", _stated(joints=["shoulder", "\x1b[31mred"]), "cannot be printed"),
    ("joint of a kilobyte", _stated(joints=["shoulder", "e" * 1000]), "joints.1"),
    ("too many joints", _stated(joints=[f"j{i}" for i in range(5000)]), "joints"),
    ("joint that the robot lacks", _stated(joints=["shoulder", "knee"]), "knee"),
    ("sensor twice", _stated(sensors=[_FOOT, _FOOT]), "'f' stands twice"),
    ("unknown effect", _stated(modelled=["rigid_body", "magic"]), "unknown name 'magic'"),
    ("effect twice", _stated(modelled=["rigid_body", "rigid_body"]), "stands twice"),
    ("unknown torque", _stated(torque="guessed"), "torque"),
    ("unknown base", _stated(base="flying"), "base"),
    ("no torque of any", _stated(no_torque=["shoulder", "elbow"]), "names every joint"),
    ("no torque of a stranger", _stated(no_torque=["knee"]), "no joint 'knee'"),
)
_REFERENCES = (
    ("repeats itself", _trial(repeats="two.csv"), "repeats it"),
    (
        "repeat each other",
        _stated(
            trials=[
                {"file": "one.csv", "role": "identification", "repeats": "two.csv"},
                {"file": "two.csv", "role": "validation", "repeats": "one.csv"},
            ]
        ),
        "repeats it",
    ),
    ("repeats a stranger", _trial(repeats="three.csv"), "no trial of this log"),
    ("trial twice", _trial(file="one.csv"), "stands twice"),
    ("trial in two formats", _trial(file="one.npz"), "'one' stands twice"),
    ("coupling without inverse", _stated(coupling={"elbow": {"elbow": 0.0}}), "coupling: has no inverse"),
    (
        "coupling of equal rows",
        _stated(coupling={"elbow": {"shoulder": 1.0, "elbow": 0.0}}),
        "coupling: has no inverse",
    ),
    ("coupling of inf", _stated(coupling={"elbow": {"shoulder": float("inf")}}), "coupling.elbow"),
    ("coupling of a stranger", _stated(coupling={"knee": {"elbow": 1.0}}), "knee"),
    ("gain of inf", _stated(controller={"kp": {"elbow": float("inf")}}), "controller.kp.elbow"),
    ("gain of nan", _stated(controller={"kd": {"elbow": float("nan")}}), r"kd.*\.nan"),
    ("gain negative", _stated(controller={"kp": {"elbow": -200.0}}), "controller.kp.elbow"),
    ("gain in words", _stated(controller={"kp": "stiff"}), "controller.kp"),
    ("gain of a stranger", _stated(controller={"kp": {"knee": 1.0}}), "no joint 'knee'"),
    ("servo's rate inf", _stated(controller={"rate_hz": float("inf")}), "controller.rate_hz"),
)
_PATHS = (
    ("above the log", _trial(file="../../etc/passwd"), "outside the folder"),
    ("absolute", _trial(file="/etc/passwd"), "outside the folder"),
    ("above by backslashes", _trial(file="..\\..\\secret.csv"), "outside the folder"),
    ("zero byte", _stated(robot="a\0b"), "robot.*cannot be printed"),
    ("too long", _trial(file="x" * 300 + ".csv"), "too long"),
    ("not there", _trial(file="three.csv"), "no such file"),
    ("unknown format", _trial(file="two.xlsx"), "unknown format"),
    ("no ending", _trial(file="two"), "unknown format"),
    ("a pipe", _file(".csv", _pipe), "is a pipe"),
    ("a folder", _file(".parquet", _folder), "is a folder"),
    ("a device", _file(".csv", _link("/dev/zero")), "is a device"),
    ("a link to nothing", _file(".npz", _link("nowhere.npz")), "no such file"),
    ("a link to itself", _file(".npz", _link("one.npz")), "cannot be read"),
    ("no log at all", lambda folder: ["diagnose", str(folder / "missing")], "no such file"),
    ("folder without log.yaml", lambda folder: ["diagnose", str(folder)], "log.yaml: no such file"),
    ("log of a kilobyte's name", lambda folder: ["diagnose", "x" * 1000], "too long"),
    ("log is a device", lambda folder: ["diagnose", "/dev/zero"], "is a device"),
)
_ROBOT = (
    ("not there", _robot(_nothing, "other.urdf"), "robot: no such file"),
    ("a device", _robot(_link("/dev/zero")), "robot"),
    ("a pipe", _robot(_pipe), "robot"),
    ("a folder", _robot(_folder), "robot"),
    ("no XML", _robot(_bytes(lambda data: b"nothing")), "XML|not well-formed"),
    ("cut", _robot(_bytes(lambda data: data[:300])), "XML"),
    ("name too long", _robot(_nothing, "r" * 300 + ".urdf"), "robot.*too long"),
)
_PARQUET = (
    ("empty", _file(".parquet", _bytes(lambda data: b"")), "cannot be read"),
    ("cut", _file(".parquet", _bytes(lambda data: data[: len(data) // 2])), "cannot be read"),
    ("other bytes", _file(".parquet", _bytes(lambda data: b"PAR1" + bytes(500) + b"PAR1")), "cannot be read"),
    ("footer beyond the file", _file(".parquet", _bytes(_footer(2**31 - 1))), "cannot be read"),
    ("footer negative", _file(".parquet", _bytes(_footer(-5))), "cannot be read"),
    ("page changed", _file(".parquet", _bytes(lambda d: d[:400] + b"\xff" * 8 + d[408:])), "cannot be read"),
    ("words", _file(".parquet", _parquet(q__elbow=["a"] * ROWS)), "q.elbow: is not numeric"),
    ("lists", _file(".parquet", _parquet(q__elbow=[[1.0]] * ROWS)), "q.elbow.*: is not numeric|column is missing"),
    ("booleans", _file(".parquet", _parquet(tau__elbow=[True] * ROWS)), "tau.elbow: is not numeric"),
    ("dates", _file(".parquet", _parquet(time=np.arange(ROWS).astype("M8[ms]"))), "time"),
    ("gaps", _file(".parquet", _parquet(q__elbow=[None, *np.zeros(ROWS - 1)])), "q.elbow: is nan in row 0"),
    ("no rows", _file(".parquet", _parquet(**{n.replace(".", "__"): np.zeros(0) for n in columns()})), "no rows"),
)  # fmt: skip
_CSV = (
    ("empty", _file(".csv", _bytes(lambda data: b"")), "cannot be read"),
    ("names only", _file(".csv", _bytes(lambda data: data.splitlines(keepends=True)[0])), "not numeric|no rows"),
    ("ragged", _file(".csv", _line(5, "1,2")), "line 6 has 2 fields for 5 columns"),
    ("words in a column", _file(".csv", _line(5, "0.04,a,b,c,d")), "not numeric"),
    ("name twice", _file(".csv", _line(0, "time,q.shoulder,q.shoulder,tau.shoulder,tau.elbow")), "stands twice"),
    ("unknown joint", _file(".csv", _line(0, "time,q.knee,tau.shoulder,q.elbow,tau.elbow")), "q.knee"),
    ("column missing", _spoilt(tau__elbow=None), "tau.elbow: column is missing"),
    ("no time", _spoilt(time=None), "time: column is missing"),
    ("million columns", _file(".csv", _bytes(lambda data: b"," * 10**6 + b"\n")), "columns|line of more"),
    ("names without end", _file(".csv", _bytes(lambda data: b"a" * 3 * 10**6)), "line of more than"),
    ("comments without end", _file(".csv", _bytes(lambda data: b"# x\n" * 5000)), "comments"),
    ("zero bytes", _file(".csv", _bytes(lambda data: bytes(5000))), "one.csv"),
    ("no text", _file(".csv", _bytes(lambda data: b"\xff\xfet\0i\0m\0e\0\n\0" * 50)), "one.csv"),
)  # fmt: skip
_NPZ = (
    ("empty", _file(".npz", _bytes(lambda data: b"")), "cannot be read"),
    ("no archive", _file(".npz", _bytes(lambda data: b"nothing at all")), "cannot be read"),
    ("cut", _file(".npz", _bytes(lambda data: data[:-200])), "cannot be read"),
    ("check sum", _file(".npz", _bytes(lambda d: d[:300] + bytes(40) + d[340:])), "cannot be read"),
    ("bomb", _file(".npz", _bomb), "more than the"),
    ("shape beyond the file", _file(".npz", _member("x.npy", _npy("(99999999999,)"))), "declares the shape"),
    ("shape negative", _file(".npz", _member("x.npy", _npy("(-5,)"))), "declares the shape"),
    ("header without end", _file(".npz", _member("x.npy", _npy("(" * 60))), "cannot be read"),
    ("member twice", _file(".npz", _member("q.elbow.npy", _npy("(0,)"))), "stands twice"),
    ("packed otherwise", _file(".npz", _member("x.npy", _npy("(0,)"), zipfile.ZIP_LZMA)), "packed"),
    ("objects", _file(".npz", _npz(q__elbow=np.array([None] * ROWS, dtype=object))), "q.elbow: is not numeric"),
    ("a pickle beside arrays", _file(".npz", _npz(extra=np.array([{}], dtype=object))), "extra: .* pickled"),
    ("a file beside arrays", _file(".npz", _member("data.pkl", b"\x80\x04N.")), "data.pkl: is no array"),
    ("complex", _file(".npz", _npz(q__elbow=np.full(ROWS, 1 + 1j))), "q.elbow: is not numeric"),
    ("structured", _file(".npz", _npz(q__elbow=np.zeros(ROWS, dtype="f8,i4"))), "q.elbow: is not numeric"),
    ("two columns in one", _file(".npz", _npz(q__elbow=np.zeros((ROWS, 2)))), r"q.elbow: has shape \(200, 2\)"),
    ("other length", _file(".npz", _npz(q__elbow=np.zeros(5))), "q.elbow: has 5 rows"),
    ("no arrays", _file(".npz", _bytes(lambda data: b"PK\5\6" + bytes(18))), "column is missing"),
)  # fmt: skip
_HDF5 = (
    ("no file of it", _file(".h5", _bytes(lambda data: b"nothing")), "cannot be read"),
    ("cut", _file(".h5", _bytes(lambda data: data[:600])), "cannot be read"),
    ("zeroed", _file(".h5", _bytes(lambda d: d[:100] + bytes(700) + d[800:])), "one.h5"),
    ("link to a file", _file(".h5", _hdf5(_external)), "q.elbow: is a link"),
    ("link to nothing", _file(".h5", _hdf5(_soft)), "q.elbow: is a link"),
    ("virtual", _file(".h5", _hdf5(_virtual)), "q.elbow: lies in another file"),
    ("raw data elsewhere", _file(".h5", _hdf5(_raw)), "q.elbow: lies in another file"),
    ("vast", _file(".h5", _hdf5(_vast)), "more than the"),
    ("compound", _file(".h5", _hdf5(_compound)), "q.elbow: is not numeric"),
)
_MAGNITUDES = (
    ("position of 1e300", _with("q.elbow", 7, 1e300), r"q.elbow: is 1e\+300 in row 7"),
    ("position nan", _with("q.elbow", 7, np.nan), "q.elbow: is nan in row 7"),
    ("torque inf", _with("tau.shoulder", 9, np.inf), "tau.shoulder: is inf in row 9"),
    ("torque of 1e300", _with("tau.shoulder", 9, -1e300), "tau.shoulder: is -1e.300"),
    (
        "torques that never change",
        _all(**{"tau.shoulder": np.zeros(ROWS), "tau.elbow": np.full(ROWS, 3.0)}),
        r"tau\.\*: never changes",
    ),
    ("counter overflowed", _with("q.shoulder", 3, 2.0**31), "q.shoulder: is 2.147e"),
)
_CLOCKS = (
    ("nanoseconds since 1970, too slow", _spoilt(time=1.7e18 + 4e7 * np.arange(ROWS)), "nanoseconds since 1970"),
    ("milliseconds since 1970, too slow", _spoilt(time=1.7e12 + 35.0 * np.arange(ROWS)), "milliseconds since"),
    ("gap of 11 days", _spoilt(time=_CLOCK + 950400.0 * (np.arange(ROWS) > 99)), "gap of 11 days after 0.99 s"),
    ("one trial in no unit", _spoilt(time=3e4 * _CLOCK), "runs at"),
    ("nearly milliseconds", _spoilt(time=1.5e3 * _CLOCK), "time looks like milliseconds"),
    ("pause of an hour", _spoilt(time=_CLOCK + 3600.0 * (np.arange(ROWS) > 99)), "gap of 3600 s after 0.99 s"),
    ("goes back", _spoilt(time=_CLOCK[::-1]), "goes back"),
    ("constant", _spoilt(time=np.zeros(ROWS)), "1 distinct samples"),
    ("one row", _spoilt(**{n.replace(".", "__"): v[:1] for n, v in columns().items()}), "1 distinct samples"),
    ("stamp of 1e300", _with("time", ROWS - 1, 1e300), "reaches 1e"),
    ("stamp nan", _with("time", 5, np.nan), "time: is nan in row 5"),
    ("steps of an attosecond", _spoilt(time=1e-18 * np.arange(ROWS)), "distinct samples"),
)  # fmt: skip

CASES: tuple[Case, ...] = tuple(
    Case(f"log: {family}", name, build, line)
    for family, cases in (
        ("header", _HEADER),
        ("numbers of the header", _NUMBERS),
        ("names of the header", _NAMES),
        ("references of the header", _REFERENCES),
        ("paths", _PATHS),
        ("robot", _ROBOT),
        ("parquet", _PARQUET),
        ("csv", _CSV),
        ("npz", _NPZ),
        ("hdf5", _HDF5),
        ("magnitudes", _MAGNITUDES),
        ("clocks", _CLOCKS),
    )
    for name, build, line in cases
)
