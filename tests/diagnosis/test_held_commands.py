"""Gains of a servo that holds its commands, simulated here by hand."""

from __future__ import annotations

import numpy as np
import pytest

import excite
from excite.conversion.explicit_mapping import Map

_URDF = """<robot name="rod"><link name="base"/><link name="rod"><inertial><origin xyz="0.25 0 0"/><mass value="1.2"/>
<inertia ixx="0.002" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="hinge"
type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="60"
velocity="20"/></joint></robot>"""
_KP, _KD, _ROW_S = 120.0, 5.0, 0.005


def _held(path, seed):
    """A rod on a servo of 1 ms whose command is held for a row of 5 ms: positions and commands as a table."""
    rng, step = np.random.default_rng(seed), 0.001
    f, size, turn = rng.uniform(0.3, 1.2, 4), rng.uniform(0.1, 0.3, 4), rng.uniform(0.0, 6.0, 4)
    inertia = 0.03 + 1.2 * 0.25**2 + 0.02
    q, v, rows = float((size * np.sin(turn)).sum()), 0.0, []
    for k in range(12000):
        if k % 5 == 0:
            command = float((size * np.sin(2.0 * np.pi * f * k * step + turn)).sum())
            rows.append((k * step, q + 2e-5 * rng.standard_normal(), command))
        weight = 1.2 * 9.81 * 0.25 * np.cos(q)
        torque = _KP * (command - q) - _KD * v - 0.3 * np.tanh(v / 0.01) + weight
        v += step * torque / inertia
        q += step * v
    np.savetxt(path, np.array(rows)[100:], delimiter=",", header="time,q.hinge,q_cmd.hinge", comments="")
    return path


def test_damping_is_told_to_what_a_held_command_leaves_open(tmp_path):
    """A command that is held for 5 ms acts half of that late: kd was told to a thousandth, and 5 % off."""
    (tmp_path / "rod.urdf").write_text(_URDF)
    files = [_held(tmp_path / f"run_{k}.csv", k) for k in range(3)]
    stated = {"log": {"controller": {"mode": "position", "feedforward": "none"}}}
    mapping = Map.model_validate(stated)
    log = excite.convert(files, tmp_path / "rod.urdf", tmp_path / "log", mapping).log
    told = {
        one.parameter: one.size for one in excite.diagnose(log, tmp_path / "rod.urdf", budget=False).absorbed
    }
    for name, true in (("kp", _KP), ("kd", _KD)):
        low, high = (told[name].value + s * 1.645 * told[name].std for s in (-1, 1))
        assert low < true < high
    assert told["kd"].value == pytest.approx(_KD, rel=0.15)
