"""Data sets of many episodes: each fault is named in its own episode and joint, and nothing in the others."""

from __future__ import annotations

import json
from functools import partial

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from excite.conversion.episodes import examine_episodes, is_of_episodes
from excite.errors import LogError
from tests.conversion.written import ros2_store, stamp

JOINTS = ("pan", "lift", "elbow", "wrist_1", "wrist_2", "gripper")
RATE = 50.0
FAULTS = {
    3: ("command_sign", "lift"),
    7: ("constant", "elbow"),
    11: ("late", "pan"),
    16: ("missing_rows", ""),
    18: ("zero_position", "wrist_1"),
}


def episode(k, *, seconds=10.0, scale=1.0, faults=FAULTS, drift=0.0, torque=False):
    """Time, positions, commands and torques of an arm that follows its commands 60 ms late, with errors of its own."""
    rng = np.random.default_rng(k)
    time = np.arange(0.0, seconds, 1.0 / RATE)
    bends, turns = rng.uniform(0.5, 6.0, (2, 4, len(JOINTS)))
    sizes = rng.uniform(0.2, 0.5, (4, len(JOINTS)))

    def path(late):
        return (sizes * np.sin((time[:, None, None] - late) * bends + turns)).sum(axis=1)

    kind, joint = faults.get(k, ("", ""))
    delay = np.full(len(JOINTS), 0.06)
    if kind == "late":
        delay[:] += 0.1
    command = path(0.0)
    q = (1.0 + 0.01 * rng.standard_normal(len(JOINTS))) * (path(delay)) + 1e-3 * rng.standard_normal(
        command.shape
    )
    q += 2e-3 * rng.standard_normal(len(JOINTS))
    q[:, 2] += drift * k
    j = JOINTS.index(joint) if joint else 0
    if kind == "command_sign":
        q[:, j] *= -1.0
    if kind == "constant":
        q[:, j] = q[0, j]
    if kind == "zero_position":
        q[:, j] += 0.3
    speed = np.gradient(q, time, axis=0)
    tau = 2.0 * np.sign(speed) + 0.5 * speed + 3.0 * np.cos(q) + 0.05 * rng.standard_normal(q.shape)
    keep = np.ones(len(time), dtype=bool)
    if kind == "missing_rows":
        keep[200:240] = False
    return time[keep], scale * q[keep], scale * command[keep], tau[keep] if torque else None


def lerobot(folder, episodes, version):
    """A data set as its own library lays it out: a file an episode (2.1), or several in each (3.0)."""
    tables = []
    for k, (time, q, command, _) in enumerate(episodes):
        lists = [
            pa.FixedSizeListArray.from_arrays(pa.array(x.astype(np.float32).ravel()), len(JOINTS))
            for x in (q, command)
        ]
        n = len(time)
        index = [pa.array(np.full(n, k)), pa.array(np.arange(n)), pa.array(time.astype(np.float32))]
        names = ["observation.state", "action", "episode_index", "frame_index", "timestamp"]
        tables.append(pa.table([*lists, *index], names=names))
    data = folder / "data" / "chunk-000"
    data.mkdir(parents=True)
    if version == "v2.1":
        for k, table in enumerate(tables):
            pq.write_table(table, data / f"episode_{k:06d}.parquet")
    else:
        for k in range(0, len(tables), 8):
            pq.write_table(pa.concat_tables(tables[k : k + 8]), data / f"file-{k // 8:03d}.parquet")
    names = [f"{joint}.pos" for joint in JOINTS]
    feature = {"dtype": "float32", "shape": [len(JOINTS)], "names": names}
    (folder / "meta").mkdir()
    info = {
        "codebase_version": version,
        "fps": RATE,
        "features": {"observation.state": feature, "action": feature},
    }
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    return folder


def tables(folder, episodes):
    """A folder of CSV, one an episode, in the words of a log folder."""
    folder.mkdir()
    for k, (time, q, command, tau) in enumerate(episodes):
        parts = {"q": q, "q_cmd": command} | ({} if tau is None else {"tau": tau})
        names = ["time", *(f"{channel}.{joint}" for channel in parts for joint in JOINTS)]
        rows = np.column_stack([time, *parts.values()])
        np.savetxt(
            folder / f"run_{k:03d}.csv", rows, delimiter=",", header=",".join(names), comments="", fmt="%.6g"
        )
    return folder


def bags(folder, episodes):
    """A folder of bags, positions and commands in topics of one type."""
    from rosbags.rosbag2 import Writer

    store, nothing = ros2_store(), np.zeros(0)
    state = store.types["sensor_msgs/msg/JointState"]
    folder.mkdir()
    for k, (time, *both, _) in enumerate(episodes):
        with Writer(folder / f"take_{k:03d}", version=9) as writer:
            for topic, values in zip(("/joint_states", "/joint_commands"), both, strict=True):
                line = writer.add_connection(topic, state.__msgtype__, typestore=store)
                for t, row in zip(100.0 + time, values, strict=True):
                    message = state(stamp(store, t), list(JOINTS), row, nothing, nothing)
                    writer.write(line, round(1e9 * t), store.serialize_cdr(message, state.__msgtype__))
    return folder


def verdicts(chart):
    return {int(one.episode.split("_")[1]): one for one in chart.episodes if one.findings}


@pytest.mark.parametrize("layout", ["v2.1", "v3.0", "csv", "degrees", "bags"])
def test_each_fault_is_named_where_it_is_and_nothing_else(layout, tmp_path):
    made = [episode(k, scale=57.29578 if layout == "degrees" else 1.0) for k in range(20)]
    version = "v2.1" if layout == "v2.1" else "v3.0"
    data = {"csv": tables, "bags": bags}.get(layout, partial(lerobot, version=version))(
        tmp_path / "data", made
    )
    chart = examine_episodes(data)
    bad = verdicts(chart)
    assert set(bad) == set(FAULTS)
    assert set(chart.episodes[0].measures["travel"]) == set(JOINTS)
    for k, (kind, joint) in FAULTS.items():
        assert bad[k].verdict == kind
        (found,) = bad[k].findings
        assert joint in found.places or not joint or kind == "late"
    # Worst first: what makes an episode useless, then what spoils it, then those that are well.
    assert {chart.episodes[0].verdict, chart.episodes[1].verdict} == {"command_sign", "constant"}
    assert [one.verdict for one in chart.episodes][len(FAULTS) :] == ["ok"] * (20 - len(FAULTS))
    assert not chart.healthy and len(chart.to_json()["episodes"]) == 20


def test_a_set_without_faults_is_healthy(tmp_path):
    for seed in range(3):
        made = [episode(100 * seed + k, faults={}) for k in range(20)]
        chart = examine_episodes(tables(tmp_path / str(seed), made))
        assert chart.healthy and not chart.findings


def test_what_drifts_from_episode_to_episode_is_said_of_its_joint(tmp_path):
    made = [episode(k, faults={}, drift=0.004) for k in range(30)]
    chart = examine_episodes(lerobot(tmp_path / "data", made, "v3.0"))
    (found,) = [one for one in chart.findings if one.kind == "drift"]
    assert found.places == ("elbow",) and chart.healthy
    assert found.figures["zero"] == pytest.approx(0.004 * 29, rel=0.1)
    assert found.text in chart.summary()


def test_joints_that_were_held_exchanged_scaled_or_left_alone_are_told_apart(tmp_path):
    made = [episode(k, faults={}) for k in range(20)]
    for k, (_, q, command, _) in enumerate(made):
        if k == 2:
            q[:, [1, 2]] = q[:, [2, 1]]
        if k == 5:
            q[100:, 3] = q[100, 3] + 1e-3 * np.sin(np.arange(len(q) - 100))
        if k == 9:
            q[:, 4] *= np.pi / 180.0
        if k == 13:
            q[100:140, 5] = np.nan
        if k == 15:
            # The task leaves a joint where it is.
            q[:, 0], command[:, 0] = 0.2 + 1e-3 * np.random.default_rng(0).standard_normal(len(q)), 0.2
        if k == 17:
            q[250, 3] += 3.0
    bad = verdicts(examine_episodes(lerobot(tmp_path / "data", made, "v2.1")))
    assert {k: (one.findings[-1].kind, one.findings[-1].places) for k, one in bad.items()} == {
        2: ("unfollowed", ("lift", "elbow")),
        5: ("unfollowed", ("wrist_1",)),
        9: ("gain", ("wrist_2",)),
        13: ("missing_rows", ("gripper",)),
        17: ("steps", ("wrist_1",)),
    }


def test_small_motion_to_and_fro_is_no_turned_joint(data_dir):
    """A servo that is asked to move within its backlash follows half a period late as well as turned."""
    chart = examine_episodes(data_dir / "so101_sage")
    assert len(chart.episodes) == 8 and "command_sign" not in {found.kind for found in chart.findings}
    assert examine_episodes(data_dir / "bam_xl330_pendulum").healthy


def test_friction_is_compared_where_torques_are_logged(tmp_path):
    made = [episode(k, faults={}, torque=True) for k in range(12)]
    time, q, command, tau = made[5]
    tau = tau.copy()
    tau[:, 3] += 3.0 * np.sign(np.gradient(q[:, 3]))
    turned = made[8][3] * np.where(np.arange(6) == 1, -1.0, 1.0)
    made[5], made[8] = (time, q, command, tau), (*made[8][:3], turned)
    bad = verdicts(examine_episodes(tables(tmp_path / "runs", made)))
    assert {k: (one.verdict, one.findings[0].places) for k, one in bad.items()} == {
        5: ("friction", ("wrist_1",)),
        8: ("torque_sign", ("lift",)),
    }
    measured = bad[5].to_json()["measures"]["friction"]
    assert measured["pan"] == pytest.approx(2.0, rel=0.1) and measured["wrist_1"] == pytest.approx(
        5.0, rel=0.1
    )


def test_a_file_that_cannot_be_read_and_one_of_another_arm_are_episodes_with_a_verdict(tmp_path):
    folder = tables(tmp_path / "runs", [episode(k, faults={}) for k in range(6)])
    (folder / "run_006.csv").write_text("")
    (folder / "README.txt").write_text("Six runs of one arm.\n")
    (folder / "run_007.csv").write_text(
        "time,q.other\n" + "".join(f"{0.02 * k},{0.01 * k}\n" for k in range(50))
    )
    bad = verdicts(examine_episodes(folder))
    assert {k: one.verdict for k, one in bad.items()} == {6: "unreadable", 7: "channels"}


def test_what_is_no_data_set_is_told_from_one(tmp_path):
    assert not is_of_episodes(tmp_path) and not is_of_episodes(tmp_path / "nowhere")
    folder = tables(tmp_path / "runs", [episode(0)])
    assert is_of_episodes(folder)
    assert "too few to tell" in examine_episodes(folder).summary()
    (folder / "log.yaml").write_text("schema: excite.log/1\n")
    assert not is_of_episodes(folder)
    (tmp_path / "words").mkdir()
    (tmp_path / "words" / "a.csv").write_text("name\none\ntwo\n")
    with pytest.raises(LogError):
        examine_episodes(tmp_path / "words")


def test_the_command_writes_table_and_plot_and_ends_by_the_verdict(tmp_path, excite_here):
    data = lerobot(tmp_path / "data", [episode(k) for k in range(20)], "v3.0")
    done = excite_here("doctor", data, "--out", tmp_path / "out", "--json", cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    document = json.loads(done.stdout)
    assert document["schema"] == "excite.doctor/1" and len(document["episodes"]) == 20
    assert document == json.loads((tmp_path / "out" / "doctor.json").read_text())
    header, *rows = (tmp_path / "out" / "episodes.csv").read_text().splitlines()
    assert len(rows) == 20 and "zero.elbow" in header.split(",") and ",ok," in rows[-1]
    assert (tmp_path / "out" / "drift.png").read_bytes().startswith(b"\x89PNG")
    well = lerobot(tmp_path / "well", [episode(k, faults={}) for k in range(20)], "v2.1")
    done = excite_here("doctor", well, "--jobs", 2, cwd=tmp_path)
    assert done.returncode == 0 and "20 episodes, 0 with something wrong" in done.stdout
    refused = excite_here("doctor", well, "--repair", "x", cwd=tmp_path)
    assert refused.returncode == 2 and "this is a data set" in refused.stderr


@pytest.mark.parametrize(
    ("faults", "lasting"),
    [
        ({k: ("zero_position", "wrist_1") for k in range(10, 20)}, ("wrist_1", "zero", "run_010")),
        ({k: ("zero_position", "lift") for k in range(8)}, ("lift", "zero", "run_008")),
        ({k: ("zero_position", "pan") for k in range(0, 20, 2)}, ()),
        ({k: ("command_sign", "lift") for k in range(10)}, ("lift", "gain", "run_010")),
        ({k: ("command_sign", "lift") for k in range(0, 20, 2)}, ()),
    ],
    ids=["half", "before half", "in turn", "half turned", "turned in turn"],
)
def test_what_half_of_the_episodes_have_is_said(faults, lasting, tmp_path):
    """Of an arm that was set anew in the middle nothing was said: neither half stood apart from the median."""
    chart = examine_episodes(tables(tmp_path / "data", [episode(k, faults=faults) for k in range(20)]))
    turned = {k for k, (kind, _) in faults.items() if kind == "command_sign"}
    assert {k for k, one in verdicts(chart).items() if "command_sign" in one.verdict} == turned
    said = [one.text for one in chart.findings if one.kind == "drift"]
    assert any(all(word in text for word in (*lasting, "leaps")) for text in said) == bool(lasting)
    assert not (lasting and chart.healthy)


def test_joints_that_all_episodes_have_turned_are_usual(tmp_path):
    faults = {k: ("command_sign", "lift") for k in range(12) if k != 4}
    chart = examine_episodes(tables(tmp_path / "data", [episode(k, faults=faults) for k in range(12)]))
    assert {k: one.verdict for k, one in verdicts(chart).items()} == {4: "command_sign"}
