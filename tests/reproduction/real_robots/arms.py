"""Arms of which nothing is known but the recording: the largest effect after rigid bodies and friction."""

from __future__ import annotations

from pathlib import Path

from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.diagnose import diagnose
from excite.identification.identify import identify
from excite.logs.log import Log
from excite.logs.robot import nominal_robot
from tests.reproduction import airbot_play_load, airbot_play_sessions, lwr, tiago, tx40
from tests.reproduction.real_robots.entry import (
    FRICTION,
    RIGID,
    Bar,
    Entry,
    said,
    with_modelled,
    with_repeats,
)
from tests.reproduction.recordings import panda_log
from tests.reproduction.ur10e_load import with_inertials

_LINK = "rigid bodies, viscous and Coulomb friction; torques are measured behind the gears."
_MOTOR = "rigid bodies, viscous and Coulomb friction, rotor inertia."
_UNKNOWN = "nothing: no cause was published."
_NO_SINGLE_NAME = (
    "factors on the torques, friction under load and cross-talk of all joints together take a quarter of the mean "
    "square that blocks leave, 24 parameters of one size: no single name takes most of it"
)
_ONE_PATH = (
    "positions of all joints follow one another to a correlation of 0.997: on one path a factor on a torque and a "
    "spring of the joint are the same"
)


def entries(data: Path, folder: Path) -> list[Entry]:
    """Panda, LWR, TX40, TIAGo, AirBot Play."""
    return [
        _panda(data, folder),
        _lwr(data, folder),
        _tx40(data, folder),
        _tiago(data, folder),
        *_airbot(data, folder),
    ]


def _diagnosed(log: Log, *, motor: bool) -> Diagnosis:
    return diagnose(with_modelled(log, (*RIGID, *FRICTION, *(("armature",) if motor else ()))))


def _panda(data: Path, folder: Path) -> Entry:
    return Entry(
        title="Franka Panda",
        source="Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca: RA-L 2019.",
        trials="The first two thirds of 14 s were fitted, the last third judges.",
        baseline=_LINK,
        known="nothing of the gap; torque sensors of this arm are known to have zeros that drift.",
        diagnosis=(d := _diagnosed(panda_log(data, folder), motor=False)),
        bars=(_half_closed(d),),
        remark=(
            "What joint 6 lacks is a zero that is off, or has drifted: nine seconds of one motion do not tell."
        ),
    )


def _lwr(data: Path, folder: Path) -> Entry:
    return Entry(
        title="KUKA LWR 4+",
        source="Bethge, Malzahn, Tsagarakis, Caldwell: FloBaRoID. RAAD 2017.",
        trials="Half of one run and another trajectory were fitted, the other half judges.",
        baseline=_LINK,
        known="nothing of the gap; the recorder filtered the torques, so no noise floor can be read from them.",
        diagnosis=(d := _diagnosed(lwr.lwr_log(data, folder, lwr.HALF), motor=False)),
        bars=(
            _half_closed(
                d,
                "the seven joints move along two directions of joint space, four of them in unison: torque sensors' "
                "factors, cross-talk and bodies stand for each other there",
            ),
        ),
        remark="A zero of a torque sensor is what identification by hand adds first on this arm, too.",
    )


def _tx40(data: Path, folder: Path) -> Entry:
    return Entry(
        title="Stäubli TX40",
        source="Shipped with FIGAROH (Nguyen and others).",
        trials="The first 4 s were fitted, the last 2 s judge.",
        baseline=f"{_MOTOR[:-1]}; motor 6 turns with joints 5 and 6.",
        known=_UNKNOWN,
        diagnosis=(d := _diagnosed(tx40.tx40_log(data, folder, 4.0), motor=True)),
        bars=(
            _half_closed(
                d,
                "four seconds are fitted, and joints 5 and 6, which share a gear, leave what changes with time: 1.2 "
                "and 1.9 times as much in the two seconds that judge",
            ),
        ),
        remark="Four seconds are short: what the other joints leave has no name.",
    )


def _tiago(data: Path, folder: Path) -> Entry:
    return Entry(
        title="PAL TIAGo, arm 1 to 4",
        source="Shipped with FIGAROH (Nguyen and others).",
        trials="The first two thirds of 59 s were fitted, the last third judges.",
        baseline=_MOTOR,
        known="nothing of the gap; the recording's authors find their parameters poorly excited.",
        diagnosis=_diagnosed(tiago.tiago_log(data, folder), motor=True),
        bars=(),
        remark="The gap of arm 2 follows its load, as on the UR10e.",
    )


def _airbot(data: Path, folder: Path) -> list[Entry]:
    sessions, pair = airbot_play_sessions, airbot_play_load
    log = sessions.airbot_log(data, folder, (*sessions.MOTIONS, *sessions.AGAIN), (sessions.FIRST[-1],))
    repeated = with_repeats(log, {f"{name}_rep2": name for name in sessions.MOTIONS})
    motions = _diagnosed(repeated, motor=True)
    return [
        Entry(
            title="AirBot Play, five motions",
            source="Recordings published as dynamics_calibration_airbot (Zeyu1-oss).",
            trials="Four motions, each run twice, were fitted and give the noise floor; a fifth motion judges.",
            baseline=_MOTOR,
            known="no cause was published. By hand torques of the wrist come back with every 240th of a turn.",
            diagnosis=motions,
            bars=(
                *(_ripple_bar(motions, data, number) for number in (5, 6)),
                _half_closed(motions, _NO_SINGLE_NAME),
            ),
            remark=("No name takes most of what the joints leave."),
        ),
        Entry(
            title="AirBot Play, chirps with a load",
            source="Recordings published with figaroh_kinova (liuyurong129).",
            trials="The first two thirds of 30 s were fitted, the last third judges.",
            baseline=f"{_MOTOR[:-1]}; the load is part of what is fitted.",
            known=_UNKNOWN,
            diagnosis=_diagnosed(pair.chirp_log(data, folder, loaded=True), motor=True),
            bars=(),
            remark="All joints move on one path: whatever is left at one of them may be another's.",
        ),
        _airbot_load(data, folder),
        _airbot_bare(data, folder),
    ]


def _half_closed(d: Diagnosis, reason: str = "") -> Bar:
    """Half of the gap above the noise floor is closed on the trials that judge."""
    closed = d.gap.share_closed
    what = "half of what stands above the noise floor closed"
    return Bar(what, f"{100 * closed:.0f} %", closed >= 0.5, reason, own=True)


def _airbot_bare(data: Path, folder: Path) -> Entry:
    """The arm without load against its own URDF, whose inertial parameters are taken as given."""
    log = airbot_play_load.chirp_log(data, folder / "bare", loaded=False)
    d = diagnose(with_modelled(log, ("rigid_body_fixed", *FRICTION, "armature", "torque_bias")))
    gains = {
        e.location: e.parameters["gain"].value
        for e in (*d.effects, *d.candidates)
        if e.effect == "torque_gain" and "gain" in e.parameters
    }
    named = {e.location for e in d.effects if e.effect == "torque_gain"}
    return Entry(
        title="AirBot Play without load against its URDF",
        source="Recordings published with figaroh_kinova (liuyurong129).",
        trials="The first two thirds of 30 s were fitted, the last third judges.",
        baseline="inertial parameters of the URDF as given; friction, rotor inertia and offsets fitted.",
        known="by hand the logged torques of joints 4 and 5 are 1.63 and 1.59 times those of the URDF.",
        diagnosis=d,
        bars=tuple(
            Bar(
                f"gain of {joint}, {gain} by hand, within 10 %",
                f"{gains[joint]:.2f}" if joint in named else "not named",
                joint in named and abs(gains[joint] / gain - 1.0) < 0.1,
                _ONE_PATH,
            )
            for joint, gain in (("joint4", 1.63), ("joint5", 1.59))
        ),
    )


def _ripple_bar(d: Diagnosis, data: Path, number: int) -> Bar:
    """Whether the ripple of a joint is named with as many periods a turn as by hand."""
    periods, size = airbot_play_sessions.waves_a_turn(data, number)
    found = [
        e.parameters["periods_per_rev"].value
        for e in d.effects
        if (e.effect, e.location) == ("torque_ripple", f"joint{number}")
    ]
    return Bar(
        f"ripple of joint {number} with {periods:.0f} periods a turn, by hand {1000.0 * size:.0f} mN·m",
        f"{found[0]:.1f}" if found else "not named",
        bool(found) and abs(found[0] - periods) < 1.0,
    )


def _airbot_load(data: Path, folder: Path) -> Entry:
    bare = airbot_play_load.chirp_log(data, folder, loaded=False)
    robot = nominal_robot(bare)
    arm = with_inertials(robot, identify(robot, bare, "lmi").parameters)
    loaded = airbot_play_load.chirp_log(data, folder, loaded=True)
    modelled = ("rigid_body_fixed", *FRICTION, "armature", "torque_bias")
    d = diagnose(with_modelled(loaded, modelled), arm)
    together = [finding for finding in d.faults if finding.kind == "unison"]
    return Entry(
        title="AirBot Play, load not modelled",
        source="Recordings published with figaroh_kinova (liuyurong129).",
        trials="The first two thirds of 30 s were fitted, the last third judges.",
        baseline="inertial parameters as identified from the chirps without load; friction, rotor inertia, offsets.",
        known=f"{airbot_play_load.STATED_MASS} kg at the gripper; joints' torque scales were never calibrated.",
        diagnosis=d,
        bars=(
            Bar("no firm name for what no single effect explains", said(d), d.verdict != "effect"),
            Bar(
                "all joints move on one path: no list of effects is told from another",
                "said" if together else "not said",
                bool(together),
            ),
        ),
        remark=(
            "Weighed with both runs, joints 2 and 3 give 1.5 to 1.6 times what they log and the others what they log. "
            "So the wrist feels a load that shoulder and elbow do not seem to carry, and on one path through joint "
            "space a body, gears that give way and torque scales stand for each other."
        ),
    )
