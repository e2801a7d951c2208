"""Chosen motions of four humanoids and a quadruped, replayed with contact on robots that are not quite their models."""

from __future__ import annotations

from itertools import cycle

from excite.campaign.plan import Plan, plan
from excite.robot.loading import load_robot
from excite.simulation.replay import Replay
from tests.benchmarks.table import Row
from tests.simulation.motions import replay_motion

_ROBOTS = ("g1", "g1_no_ft", "talos", "hrp2like", "go2")
_CANDIDATES, _SEED = 24, 5
# Relative errors of all masses and of the soles' friction; each motion is run with the next of the four.
_ERRORS = ((0.05, -0.05), (0.05, 0.05), (-0.05, -0.05), (-0.05, 0.05))
_SLIP_MM = 5.0


def rows() -> list[Row]:
    """Plan for each robot, replay what was chosen, and say what the replays and the plans came to."""
    found = []
    for name in _ROBOTS:
        made = plan(load_robot(name), n_candidates=_CANDIDATES, seed=_SEED, jobs=2)
        found += [*_replayed(made), *_planned(made)]
    return found


def _replayed(made: Plan) -> list[Row]:
    name = made.robot.name
    errors = zip(made.motions, cycle(_ERRORS), strict=False)
    runs: list[Replay] = [
        replay_motion(made.robot, m, mass_error=mass, friction_error=mu) for m, (mass, mu) in errors
    ]
    fell, touched = sum(run.fell for run in runs), sum(run.self_collided for run in runs)
    title = f"{name}: {len(runs)} chosen motions replayed, mass and friction ±5 %"
    return [
        Row.holds(
            f"{title}: fall, touch themselves",
            "none, none",
            f"{fell}, {touched}",
            bool(runs) and fell + touched == 0,
        ),
        Row.at_most("… largest slip of a foot", 1e3 * max(run.max_slip_m for run in runs), _SLIP_MM, "mm"),
    ]


def _planned(made: Plan) -> list[Row]:
    """Whether the legs swing, and whether the chosen motions excite every structural base parameter."""
    swings = [motion for motion in made.accepted if motion.metadata.generator == "leg_swing"]
    refused = ", ".join(f"{count} {reason}" for reason, count in sorted(made.rejected.items())) or "none"
    rank, full = made.conditioning.rank, made.conditioning.n_base_parameters
    return [
        Row.holds("… base-link regressor, rank of the chosen motions", str(full), str(rank), rank == full),
        Row(
            f"… accepted of {made.generated} candidates",
            "",
            f"{len(made.accepted)}, {len(swings)} of them leg swings; refused: {refused}",
            None,
        ),
    ]
