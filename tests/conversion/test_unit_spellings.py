"""Units in any spelling, in names of columns, in files and in maps; units of another quantity are asked about."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

import excite
from excite.conversion.columns.words import read_clue
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import UnclearError
from excite.logs.units import QUANTITY_OF_UNIT, TO_SI, parse_unit, unit_named
from tests.conversion import written

pytestmark = pytest.mark.usefixtures("unexamined")
DEG, POUND, G = math.pi / 180.0, 4.4482216152605, 9.80665
# By what it is of, its size in SI and how people write it; sizes from the definitions of the units.
SPELLINGS: dict[tuple[str, float], str] = {
    ("v", 1.0): "rad/s|rad s^-1|rad.s^-1|rad·s⁻¹|rad s-1|radps|rad_per_s|radians_per_second|rad/sec|rad_s",
    ("v", DEG): "deg/s|degps|dps|deg_s|deg s^-1|deg_per_sec|degrees/s|°/s|deg/second",
    ("v", 2.0 * math.pi / 60.0): "rpm|RPM|rev/min|r/min|U/min",
    ("v", 2.0 * math.pi): "rev/s|rps|turns/s|turns_per_s",
    ("v", 1e-3): "mrad/s|mm/s|mmps",
    ("a", 1.0): "rad/s2|rad/s^2|rad/s²|rad s^-2|rad·s⁻²|rad/s/s|rad/s**2|radps2|rad_per_s2|rads2",
    ("a", DEG): "deg/s2|deg/s²|degps2|deg_s2|°/s²",
    ("a", 2.0 * math.pi / 60.0): "rpm/s",
    ("tau", 1.0): "Nm|N.m|N·m|N m|N*m|N-m|N_m|newton_meters|Newton metres",
    ("tau", 1e-3): "mNm|mN.m|mN·m|mN m|N·mm|Nmm|N.mm|N mm|N-mm|N_mm",
    ("tau", 1e-2): "Ncm|N·cm|N cm|cNm",
    ("tau", 1e3): "kNm|kN·m|kN m",
    ("tau", 1e-6): "µNm|uNm",
    ("tau", 0.01 * G): "kgf·cm|kgf.cm|kgfcm|kgf cm|kgf_cm|kgf-cm|kg·cm|kg cm|kgcm|kg_cm",
    ("tau", G): "kgf·m|kgf m|kgfm",
    ("tau", 1e-5 * G): "gf·cm|gcm",
    ("tau", POUND / 16.0 * 0.0254): "ozf·in|oz·in|oz-in|ozin|oz in|oz_in|ozf_in",
    ("tau", POUND * 0.0254): "lbf·in|lb-in|in-lb|in·lbf|lbf in",
    ("tau", POUND * 0.3048): "lbf·ft|ft-lb|ft·lbf|ft_lb|lbft",
}
ALL = [(kind, size, text) for (kind, size), texts in SPELLINGS.items() for text in texts.split("|")]
WORDS = {"v": "vel", "a": "acc", "tau": "torque"}
SINGLE = {
    "rad": ("q", 1.0), "degrees": ("q", DEG), "revolutions": ("q", 2.0 * math.pi), "mdeg": ("q", 1e-3 * DEG),
    "turns": ("q", 2.0 * math.pi), "A": ("i", 1.0), "mA": ("i", 1e-3), "amperes": ("i", 1.0), "milliamps": ("i", 1e-3),
}  # fmt: skip


@pytest.mark.parametrize(("kind", "size", "text"), ALL)
def test_units_are_read_by_their_parts(kind: str, size: float, text: str) -> None:
    unit = unit_named(text)
    assert QUANTITY_OF_UNIT[unit] == kind
    assert TO_SI[unit] == pytest.approx(size, rel=1e-6)


@pytest.mark.parametrize(
    "style",
    ["{joint}_{word}_{unit}", "{word}_{joint} [{unit}]", "{joint}.{word} ({unit})", "{word}_{unit}_{joint}"],
)
@pytest.mark.parametrize(("kind", "size", "text"), ALL)
def test_names_state_units_in_any_spelling(kind: str, size: float, text: str, style: str) -> None:
    said = read_clue(style.format(joint="elbow", word=WORDS[kind], unit=text), written.JOINTS)
    assert (said.quantity, said.exact) == (kind, "elbow")
    assert TO_SI[said.unit] == pytest.approx(size, rel=1e-6)


@pytest.mark.parametrize("text", SINGLE)
def test_single_words_are_units(text: str) -> None:
    kind, size = SINGLE[text]
    said = read_clue(f"elbow_{'pos' if kind == 'q' else 'current'}_{text}", written.JOINTS)
    assert (said.quantity, TO_SI[said.unit]) == (kind, pytest.approx(size))


@pytest.mark.parametrize(
    "text", ["joint", "q_m", "N/m", "Nm/rad", "Nms", "time_s", "spam", "s", "pos_r_s", "rad/", "·", ""]
)
def test_what_is_no_unit_of_a_joint_is_none(text: str) -> None:
    parsed = parse_unit(text)
    assert parsed is None


def test_letters_of_a_name_are_no_seconds() -> None:
    """The side of a leg, or ticks a second, were velocities in seconds."""
    assert read_clue("elbow_vel_s", written.JOINTS).unit == ""
    assert read_clue("elbow_vel_ticks/s", written.JOINTS).unit == ""
    assert read_clue("elbow_vel_rads", written.JOINTS).unit == "rad/s"


def table(file: Path, names: dict[str, np.ndarray]) -> Path:
    np.savetxt(
        file,
        np.column_stack(list(names.values())),
        delimiter=",",
        header=",".join(names),
        comments="",
        fmt="%.9g",
    )
    return file


def columns(data: dict[str, np.ndarray], **parts: tuple[str, float]) -> dict[str, np.ndarray]:
    """Columns by name: for each channel how its names end, and the size of its unit."""
    made = {"time_s": data["time"]}
    for channel, (ending, size) in parts.items():
        made |= {f"{joint}_{ending}": data[channel][:, k] / size for k, joint in enumerate(written.JOINTS)}
    return made


@pytest.mark.parametrize(
    ("torque", "size"),
    [("torque_N_mm", 1e-3), ("torque mN·m", 1e-3), ("torque_kgf_cm", 0.01 * G), ("torque oz_in", 0.00706155)],
)
def test_a_recordings_units_are_its_names(torque: str, size: float, tmp_path: Path) -> None:
    """Millinewton metres were newton metres, and kilogram-force centimetres hundredths of them."""
    data, robot = written.motion(), written.arm_urdf(tmp_path / "arm.urdf")
    file = table(
        tmp_path / "run.csv",
        columns(data, q=("pos_deg", DEG), v=("vel_deg_per_s", DEG), tau=(torque, size)),
    )
    (trial,) = written.whole(file, robot, tmp_path).log.trials
    np.testing.assert_allclose(trial.q, data["q"], atol=1e-6)
    np.testing.assert_allclose(trial.v, data["v"], atol=1e-6)
    np.testing.assert_allclose(trial.tau, data["tau"], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ({"v": ("vel_Nm", 1.0)}, "are velocities by their names and state N·m, a unit of torques"),
        ({"q": ("pos_rad_s", 1.0)}, "are positions by their names and state rad/s, a unit of velocities"),
        (
            {"tau": ("torque_deg", 1.0)},
            "are torques or forces by their names and state deg, a unit of positions",
        ),
        (
            {"tau": ("torque_mA", 1.0)},
            "are torques or forces by their names and state mA, a unit of currents",
        ),
    ],
)
def test_a_unit_of_another_quantity_is_asked_about(
    parts: dict[str, tuple[str, float]], said: str, tmp_path: Path
) -> None:
    """In one line; what it proposes settles it."""
    data, robot = written.motion(), written.arm_urdf(tmp_path / "arm.urdf")
    names = {"q": ("pos_rad", 1.0), "v": ("vel_rad/s", 1.0), "tau": ("torque_Nm", 1.0)} | parts
    file = table(tmp_path / "run.csv", columns(data, **names))
    with pytest.raises(UnclearError, match=said) as error:
        excite.convert([file], robot, tmp_path / "log")
    assert len(error.value.questions) == 1 and "\n" not in str(error.value)
    assert not (tmp_path / "log").exists()
    channel = next(iter(parts))
    usual = {"q": "rad", "v": "rad/s", "tau": "N·m"}[channel]
    assert f"units: {{{channel}: {usual}}}" in error.value.questions[0].line
    (trial,) = written.whole(file, robot, tmp_path, units={channel: usual}).log.trials
    np.testing.assert_allclose(getattr(trial, channel), data[channel], atol=1e-6)


def test_an_angles_unit_of_velocities_is_its_rate_where_positions_say_so(tmp_path: Path) -> None:
    data, robot = written.motion(), written.arm_urdf(tmp_path / "arm.urdf")
    names = columns(data, q=("pos_rad", 1.0), v=("vel_deg", DEG), tau=("torque_Nm", 1.0))
    (trial,) = written.whole(table(tmp_path / "run.csv", names), robot, tmp_path).log.trials
    np.testing.assert_allclose(trial.v, data["v"], atol=1e-6)


def test_counts_of_unknown_size_are_asked_about(tmp_path: Path) -> None:
    """Small numbers of them were taken for degrees."""
    data, robot = written.motion(), written.arm_urdf(tmp_path / "arm.urdf")
    counts = data | {"q": np.round(data["q"] * 30.0)}
    names = columns(counts, q=("pos_counts", 1.0), tau=("torque_Nm", 1.0))
    with pytest.raises(UnclearError, match="how many are a turn"):
        excite.convert([table(tmp_path / "run.csv", names)], robot, tmp_path / "log")


def test_maps_take_any_spelling_and_name_what_they_do_not_know() -> None:
    stated = {
        "q": "degrees",
        "v": "rad s^-1",
        "tau": "mN·m",
        "i": "milliamps",
        "a": "deg/s**2",
        "q_cmd": "counts/4096",
    }
    units = Map.model_validate({"units": stated}).units
    assert units == {
        "q": "deg",
        "v": "rad/s",
        "tau": "N·mm",
        "i": "mA",
        "a": "deg/s2",
        "q_cmd": "counts/4096",
    }
    with pytest.raises(ValidationError, match="no unit: furlong"):
        Map.model_validate({"units": {"q": "furlong"}})
