"""Friction and restitution of the ground: a body that obeys the law exactly, MuJoCo's, and real tosses of a cube."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import excite
from excite.errors import InputError

HALF, STEP, GRAVITY = 0.05, 1.0 / 150.0, 9.81
CORNERS = HALF * np.array(list(product((-1.0, 1.0), repeat=3)))
MASS, INERTIA = 0.4, 0.4 * 2.0 / 3.0 * HALF**2
Toss = excite.recordings.Toss


def struck(rng: np.random.Generator, friction: float, restitution: float) -> excite.recordings.Toss:
    """A flight, one touch of a corner by Newton's and Coulomb's laws, a flight until another corner touches."""
    turn = pin.rpy.rpyToMatrix(*rng.uniform([0.5, 0.5, -3.0], [0.8, 0.7, 3.0]))
    place, speed = np.array([0.0, 0.0, 0.3]), np.append(rng.uniform(1.5, 2.5, 2), -0.5)
    rate, fine = rng.uniform(-1.0, 1.0, 3), 1e-4
    poses, hit = [], False
    for k in range(6000):
        arms = CORNERS @ turn.T
        lowest = int(arms[:, 2].argmin())
        arm = arms[lowest]
        if place[2] + arm[2] < 0.0 and speed[2] + np.cross(rate, arm)[2] < 0.0:
            if hit:
                break
            came = speed + np.cross(rate, arm)
            along = np.append(-came[:2] / np.hypot(*came[:2]), 0.0)
            push = np.array([0.0, 0.0, 1.0]) + friction * along
            gives = push / MASS + np.cross(np.cross(arm, push) / INERTIA, arm)
            impulse = -(1.0 + restitution) * came[2] / gives[2] * push
            speed, rate, hit = speed + impulse / MASS, rate + np.cross(arm, impulse) / INERTIA, True
        if k % round(STEP / fine) == 0:
            poses.append((place.copy(), turn.copy()))
        place = place + fine * speed - [0.0, 0.0, 0.5 * GRAVITY * fine**2]
        speed = speed - [0.0, 0.0, GRAVITY * fine]
        turn = pin.exp3(fine * rate) @ turn
    return _toss(poses)


def slid(rng: np.random.Generator, friction: float) -> excite.recordings.Toss:
    """A cube on its face that slides until it rests."""
    speed, yaw = rng.uniform(0.8, 1.5), pin.rpy.rpyToMatrix(0.0, 0.0, rng.uniform(-3.0, 3.0))
    stops = speed / (friction * GRAVITY)
    time = np.arange(60) * STEP
    way = speed * np.minimum(time, stops) - 0.5 * friction * GRAVITY * np.minimum(time, stops) ** 2
    place = np.column_stack([way, 0.0 * way, np.full(len(time), HALF)])
    return Toss(
        time, place + 1e-4 * rng.standard_normal(place.shape), np.repeat(yaw[None], len(time), axis=0)
    )


def spun(rng: np.random.Generator, friction: float) -> excite.recordings.Toss:
    """A cube on its face that turns while it slides: four corners carry a quarter each and slip their own ways."""
    place, speed = np.array([0.0, 0.0, HALF]), np.append(rng.uniform(0.8, 1.5, 2), 0.0)
    angle, rate, fine, poses = 0.0, rng.uniform(8.0, 20.0), 1e-4, []
    for k in range(round(60 * STEP / fine)):
        turn = pin.rpy.rpyToMatrix(0.0, 0.0, angle)
        arms = CORNERS[CORNERS[:, 2] < 0.0] @ turn.T
        slips = (speed + np.cross([0.0, 0.0, rate], arms))[:, :2]
        forces = (
            -0.25
            * friction
            * MASS
            * GRAVITY
            * slips
            / np.maximum(np.linalg.norm(slips, axis=1), 1e-3)[:, None]
        )
        if k % round(STEP / fine) == 0:
            poses.append((place.copy(), turn))
        speed[:2] += fine * forces.sum(axis=0) / MASS
        rate += fine * float(arms[:, 0] @ forces[:, 1] - arms[:, 1] @ forces[:, 0]) / INERTIA
        place, angle = place + fine * speed, angle + fine * rate
    return _toss(poses)


def test_friction_of_a_face_that_turns_as_it_slides_is_not_all_along_its_way() -> None:
    rng = np.random.default_rng(4)
    tosses = [*(slid(rng, 0.3) for _ in range(6)), *(spun(rng, 0.3) for _ in range(24))]
    assert excite.recordings.diagnose_tosses(tosses, CORNERS).effects[
        "ground_friction"
    ].value == pytest.approx(0.3, rel=0.03)


def _toss(poses: list[tuple[np.ndarray, np.ndarray]]) -> excite.recordings.Toss:
    places, turns = map(np.array, zip(*poses, strict=True))
    return Toss(np.arange(len(places)) * STEP, places, turns)


@pytest.mark.parametrize(("friction", "restitution"), [(0.15, 0.3), (0.25, 0.6)])
def test_the_laws_come_back(friction: float, restitution: float) -> None:
    rng = np.random.default_rng(2)
    tosses = [slid(rng, friction) for _ in range(8)] + [struck(rng, friction, restitution) for _ in range(60)]
    found = excite.recordings.diagnose_tosses(tosses, CORNERS).effects
    assert found["ground_friction"].value == pytest.approx(friction, rel=0.03)
    assert found["impact_friction"].value == pytest.approx(friction, rel=0.1)
    assert found["restitution"].value == pytest.approx(restitution, abs=0.05)
    assert all(one.low <= one.value <= one.high for one in found.values())


def test_a_slide_in_mujoco() -> None:
    scene = (
        '<mujoco><option timestep="0.001" cone="elliptic" impratio="100"/><worldbody><geom type="plane" size="9 9 1" '
        'friction="0.3"/><body pos="0 0 0.051"><freejoint/><geom type="box" size="0.05 0.05 0.05" mass="0.4" '
        'friction="0.3 0 0"/></body></worldbody></mujoco>'
    )
    model, rng, tosses = mujoco.MjModel.from_xml_string(scene), np.random.default_rng(1), []
    for _ in range(6):
        data, poses = mujoco.MjData(model), []
        data.qvel[:2] = rng.uniform(0.5, 1.0, 2)
        for k in range(800):
            if k % 7 == 0:
                poses.append((data.qpos[:3].copy(), data.xmat[1].reshape(3, 3).copy()))
            mujoco.mj_step(model, data)
        places, turns = map(np.array, zip(*poses, strict=True))
        tosses.append(Toss(0.007 * np.arange(len(places)), places, turns))
    found = excite.recordings.diagnose_tosses(tosses, CORNERS)
    assert found.effects["ground_friction"].value == pytest.approx(0.3, rel=0.03)
    # Nothing struck: what would tell is said.
    assert set(found.lacking) == {"impact_friction", "restitution"} and "askew" in found.summary()


def test_wrong_units_are_one_line() -> None:
    rng = np.random.default_rng(3)
    tosses = [slid(rng, 0.2), *(struck(rng, 0.2, 0.4) for _ in range(3))]
    centimetres = [Toss(one.time, 100.0 * one.position, one.rotation) for one in tosses]
    with pytest.raises(InputError, match=r"fall with 9\d\d m/s².*give metres"):
        excite.recordings.diagnose_tosses(centimetres, 100.0 * CORNERS)
    turned = [Toss(one.time, one.position * [1.0, 1.0, -1.0], one.rotation) for one in tosses]
    with pytest.raises(InputError, match=r"fall with -\d.*z up"):
        excite.recordings.diagnose_tosses(turned, CORNERS)
    with pytest.raises(InputError, match="corners: have the shape"):
        excite.recordings.diagnose_tosses(tosses, CORNERS[:0])
    with pytest.raises(InputError, match="never lies on a face"):
        excite.recordings.diagnose_tosses(tosses[1:], CORNERS)


def test_a_real_cube(data_dir: Path) -> None:
    """Its authors state a friction of 0.18 and a restitution of 0.125, fitted or nominal ones of their simulator.

    Sliding it is slowed by more, and struck at a corner by less; single corners leave with more than that.
    """
    folder = data_dir / "contact_cube_tosses"
    held, stated = np.load(folder / "tosses.npz"), json.loads((folder / "experiment.json").read_text())
    half = 0.0524
    tosses = []
    for number in range(0, 450, 4):
        state = held["state"][held["toss"] == number]
        turns = np.array([pin.Quaternion(*q).normalized().matrix() for q in state[:, 3:7]])
        tosses.append(Toss(stated["dt"] * np.arange(len(state)), half * state[:, :3], turns))
    found = excite.recordings.diagnose_tosses(tosses, half * np.array(stated["vertices"]))
    slides, strikes = found.effects["ground_friction"], found.effects["impact_friction"]
    assert strikes.low < stated["mu"] < slides.high and slides.high - slides.low < 0.02
    assert slides.value == pytest.approx(0.18, abs=0.05) and 0.1 < found.effects["restitution"].value < 0.4
