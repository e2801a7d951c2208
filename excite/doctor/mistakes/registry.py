"""All mistakes in how channels are called, by the equations that betray them."""

from __future__ import annotations

from excite.doctor.mistakes.base_frame import BaseFrame
from excite.doctor.mistakes.clock import Clock
from excite.doctor.mistakes.degrees import Degrees, Revolutions
from excite.doctor.mistakes.direction import Direction
from excite.doctor.mistakes.gravity import Gravity
from excite.doctor.mistakes.mistake import Mistake
from excite.doctor.mistakes.order import Order, PositionOrder, TorqueOrder
from excite.doctor.mistakes.position_sign import PositionSign
from excite.doctor.mistakes.torque_late import TorqueLate
from excite.doctor.mistakes.torque_scale import TorqueScale
from excite.doctor.mistakes.torque_sign import TorqueSign
from excite.doctor.mistakes.weight import Weight
from excite.doctor.mistakes.wrenches import WrenchAxes, WrenchOrder, WrenchSign, WrenchUnit
from excite.doctor.mistakes.zero_position import ZeroPosition
from excite.doctor.mistakes.zeroed_wrenches import ZeroedWrenches
from excite.doctor.torque_samples import TorqueSamples
from excite.doctor.wrench_samples import WrenchSamples

OF_TORQUES: tuple[Mistake[TorqueSamples], ...] = (
    TorqueSign(),
    TorqueOrder(),
    TorqueScale(),
    Degrees(),
    Revolutions(),
    PositionSign(),
    Direction(),
    Order(),
    ZeroPosition(),
    Gravity(),
    Weight(),
    Clock(),
    TorqueLate(),
)

OF_WRENCHES: tuple[Mistake[WrenchSamples], ...] = (
    WrenchSign(),
    WrenchOrder(),
    WrenchAxes(),
    WrenchUnit(),
    ZeroedWrenches(),
    BaseFrame(),
    Degrees(),
    Revolutions(),
    PositionSign(),
    PositionOrder(),
    # One alone shows in how a robot stands.
    ZeroPosition(together=0),
    Gravity(),
    TorqueLate(),
)
