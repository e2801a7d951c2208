"""KUKA LBR iiwa: the number of base parameters of Xu et al., IEEE Access 2020, Table 4."""

from __future__ import annotations

from excite.regressor.base_parameters import structural_base_parameters
from excite.robot.loading import load_robot


def test_57_base_parameters_are_43_of_bodies_and_14_of_friction() -> None:
    iiwa = load_robot("iiwa14")
    assert structural_base_parameters(iiwa, ()).rank == 43
    assert structural_base_parameters(iiwa, ("viscous", "coulomb")).rank == 57
