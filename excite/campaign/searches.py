"""Searches for candidates by name. A new one is one file beside this one and one line here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from excite.registry import Registry

if TYPE_CHECKING:
    from excite.campaign.optimised_series import CandidateSearch


SEARCHES: Registry[CandidateSearch] = Registry(
    "generator",
    {
        "optimised_fourier": "excite.campaign.optimised_series:OptimisedSeries",
        "gradient": "excite.campaign.gradient_search:GradientDesign",
    },
)

MIXTURE = "mixture"
"""Asks for the robot's usual generators together, as nothing does where no minutes are given."""
