"""How much of each limit repairs use."""

from __future__ import annotations

from dataclasses import dataclass

from excite.robot.legs import TORQUE_SHARE
from excite.safety.parameter_set import ParameterSet


@dataclass(frozen=True)
class Shares:
    """How much of each limit repairs use, so that the verdict finds a margin.

    Attributes:
        velocity: of the joint velocity (Jovic et al. 2015, section II.B: 80 %).
        acceleration: of the joint acceleration.
        torque: of the joint torque, for joints outside legs.
        leg_torque: of the joint torque in legs, where the sharing of the load is an assumption.
        jerk: of the joint jerk.
        friction: of the friction coefficient.
        friction_one_foot: the same over one foot, which a quick swing of the other leg turns about its sole's middle.
        weight: smallest share of the weight that the ground carries.
        zmp: distance of the zero-moment point from the support polygon's edge [m].
        zmp_both_feet: where both feet stay down that distance is at most this share of the polygon's inradius.
        zmp_one_foot: over one foot it is at most this share of the sole's inradius: the centre of mass
            stands off the sole's middle there.
        zmp_inwards: distance from the edges that face the free foot, where that is less [m]: the centre of mass
            stands nearer to them, which would leave broad feet no room to swing a leg faster than statically, and
            a robot that tips over them steps on its other foot. The verdict asks for 0.015 m.
        zmp_shift: the same while the weight shifts from two feet to one or back, where a push outwards tips the
            robot over the foot's outer edge.
        robots: for all of which the limits shall hold, too; None for the model's own alone.
        of_robots: of torque and friction, for each of these: what smoothing and the finer grid of the verdict need,
            where the other shares also leave room for robots that are not as the model says.
    """

    velocity: float = 0.8
    acceleration: float = 0.92
    torque: float = TORQUE_SHARE
    leg_torque: float = 0.6
    jerk: float = 0.97
    friction: float = 0.6
    friction_one_foot: float = 0.4
    weight: float = 0.5
    zmp: float = 0.066
    zmp_both_feet: float = 0.87
    zmp_one_foot: float = 0.64
    zmp_inwards: float = 0.02
    zmp_shift: float = 0.7
    robots: ParameterSet | None = None
    of_robots: float = 0.95
