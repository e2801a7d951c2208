"""Drawn recordings as data loggers of machines write them: dates, decimal commas, lines of units, currents in mA.

What :mod:`tests.conversion.drawn` draws is what programmers write; this is what comes out of drives' own software,
spreadsheets and laboratories: preambles, encodings of Windows, stamps as dates or nanoseconds, rows that are missing.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import excite
from tests.conversion.drawn import ROBOTS, TICKS, Drawn, _motion

STYLES = (
    ("Achse{n}_Ist_Winkel", "Achse{n}_Ist_Drehzahl", "Achse{n}_Ist_Moment", "Achse{n}_Soll_Winkel"),
    ("J{n} actual position", "J{n} actual speed", "J{n} actual torque", "J{n} commanded position"),
    ("Pos act A{n}", "Vel act A{n}", "Trq act A{n}", "Pos cmd A{n}"),
    ("position_mesuree_{n}", "vitesse_mesuree_{n}", "couple_mesure_{n}", "position_consigne_{n}"),
    ("fbk_pos_{n}", "fbk_vel_{n}", "fbk_eff_{n}", "cmd_pos_{n}"),
    ("arm_j{n}_theta_meas", "arm_j{n}_thetadot_meas", "arm_j{n}_tau_meas", "arm_j{n}_theta_ref"),
    ("Joint {n} angle", "Joint {n} angular velocity", "Joint {n} torque", "Joint {n} target angle"),
    ("q{n}_ist", "qp{n}_ist", "tau{n}_ist", "q{n}_soll"),
    ("log.robot.joint[{z}].position", "log.robot.joint[{z}].velocity", "log.robot.joint[{z}].torque",
     "log.robot.joint[{z}].position_setpoint"),
    ("Axis {n} Position Feedback", "Axis {n} Velocity Feedback", "Axis {n} Torque Feedback",
     "Axis {n} Position Command"),
    ("joint_positions_{z}", "joint_velocities_{z}", "joint_torques_{z}", "target_joint_positions_{z}"),
)  # fmt: skip
CURRENTS = ("Strom_A{n}", "motor_current_{n}", "I_mot{n}", "actual_current_{n}", "iq{n}")
CLOCKS = ("iso", "iso blank", "german", "day", "epoch ns", "epoch us", "ms", "s")


def draw_habits(seed: int, folder: Path) -> Drawn:
    """The recording of a seed."""
    rng = np.random.default_rng([515, seed])
    name = ROBOTS[rng.integers(len(ROBOTS))]
    robot = excite.load_robot(name)
    time, q, v, tau = _motion(robot, rng)
    n = q.shape[1]
    currents = rng.random() < 0.3
    turned = int(rng.integers(n)) if rng.random() < 0.5 and not currents else -1
    if turned >= 0:
        tau[:, turned] *= -1.0
    angle, angle_word, rate_word = [
        (1.0, "rad", "rad/s"), (np.pi / 180, "deg", "deg/s"), (np.pi / 180, "°", "°/s")
    ][rng.integers(3)]  # fmt: skip
    units = rng.choice(["none", "brackets", "line", "line in brackets"])
    if units == "none" and angle_word == "°":
        angle_word, rate_word = "deg", "deg/s"
    small = units != "none" and rng.random() < 0.3
    torque, torque_word = (1e-3, "mNm") if small else (1.0, "Nm")
    kinds = [("q", angle, angle_word), ("v", angle, rate_word)]
    if currents:
        units = "brackets" if units == "none" else units
        tau = tau / rng.uniform(0.5, 12.0, n)
        kinds.append(("i", 1e-3, "mA"))
    else:
        kinds.append(("tau", torque, torque_word))
    late = 0.004 + 0.02 * rng.random()
    command = np.column_stack([np.interp(time + late, time, column) for column in q.T])
    if rng.random() < 0.5:
        kinds.append(("q_cmd", angle, angle_word))
    if rng.random() < 0.3:
        kinds.pop(1)
    values = {
        "q": q + 2e-5 * rng.standard_normal(q.shape),
        "v": v + 2e-3 * rng.standard_normal(v.shape),
        "tau": tau,
        "i": tau,
        "q_cmd": command,
    }
    style = STYLES[rng.integers(len(STYLES))]
    pattern = dict(zip(("q", "v", "tau", "q_cmd"), style, strict=True)) | {"i": str(rng.choice(CURRENTS))}
    clock = str(rng.choice(CLOCKS))
    stamps, factor, word = _clock(time, clock, units != "none")
    header, cells, columns, factors = [word], [stamps], {"time": word}, {"time": factor}
    unit_line = [{"ms": "ms", "s": "s", "epoch ns": "ns", "epoch us": "us"}.get(clock, "")]
    for kind, scale, unit in kinds:
        factors[kind] = scale
        for k in range(n):
            label = pattern[kind].format(n=k + 1, z=k)
            label += f" [{unit}]" if units == "brackets" else ""
            columns[f"{kind}.{robot.joint_names[k]}"] = label
            header.append(label)
            unit_line.append(unit)
            cells.append([f"{x:.9g}" for x in values[kind][:, k] / scale])
    order = np.concatenate([[0], 1 + rng.permutation(len(header) - 1)])
    header, unit_line, cells = ([part[i] for i in order] for part in (header, unit_line, cells))
    file = folder / f"habits_{seed:03d}.csv"
    _write(file, header, unit_line if units.startswith("line") else None, units, cells, rng)
    return Drawn(file, name, columns, factors, robot.joint_names[turned] if turned >= 0 else "")


def _clock(time: np.ndarray, kind: str, with_unit: bool) -> tuple[list[str], float, str]:
    """Cells, seconds per unit, and the column's name."""
    start = np.datetime64("2026-03-01T11:59:55", "us")
    whole = [start + np.timedelta64(round(1e6 * t), "us") for t in time]
    if kind in ("iso", "iso blank"):
        return [str(w).replace("T", "T" if kind == "iso" else " ") for w in whole], 1.0, "Zeitstempel"
    if kind == "german":
        return [f"01.03.2026 {str(w)[11:23]}" for w in whole], 1.0, "Date/Time"
    if kind == "day":
        return [str(w)[11:] for w in whole], 1.0, "Time of day"
    if kind.startswith("epoch"):
        unit = kind[-2:]
        per = round(1.0 / TICKS[unit])
        return [str(1_767_225_600 * per + round(t * per)) for t in time], TICKS[unit], f"t_{unit}"
    return [f"{t / TICKS[kind]:.6g}" for t in time], TICKS[kind], f"Zeit [{kind}]" if with_unit else "Zeit"


def _write(
    file: Path,
    header: list[str],
    unit_line: list[str] | None,
    units: str,
    cells: list[list[str]],
    rng: np.random.Generator,
) -> None:
    separator, comma = ((",", False), (";", False), (";", True), ("\t", True), ("\t", False), ("|", False))[
        rng.integers(6)
    ]
    lines = []
    if rng.random() < 0.4:
        lines += ["Recorder 2.1", f"Operator{separator}M. Müller", f"Channels{separator}{len(cells)}", ""]
    quote = '"' if rng.random() < 0.3 and separator != "\t" else ""
    lines.append(separator.join(f"{quote}{name}{quote}" for name in header))
    if unit_line is not None:
        shown = [f"[{unit}]" if "brackets" in units and unit else unit for unit in unit_line]
        lines.append(separator.join(shown))
    trailing = separator if rng.random() < 0.2 else ""
    lost = rng.random() < 0.3
    for row, values in enumerate(zip(*cells, strict=True)):
        if lost and row % 97 == 50:
            values = (values[0], *("" for _ in values[1:]))
        text = separator.join(values)
        if comma:
            text = separator.join([values[0].replace(".", ",") if values[0].count(".") == 1 else values[0]]
                                  + [x.replace(".", ",") for x in values[1:]])  # fmt: skip
        lines.append(text + trailing)
        if lost and row % 150 == 60:
            lines.append(text + trailing)
    if rng.random() < 0.3:
        lines.append("End of recording")
    file.write_bytes("\r\n".join(lines).encode(str(rng.choice(["utf-8", "latin-1", "utf-8-sig"]))))
