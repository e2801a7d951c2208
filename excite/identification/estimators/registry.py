"""The estimators by name. A new one is one file beside this one and one line here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from excite.registry import Registry

if TYPE_CHECKING:
    from excite.identification.estimators.base import Estimator

ESTIMATORS: Registry[Estimator] = Registry(
    "method",
    {
        "ls": "excite.identification.estimators.ls:LeastSquares",
        "wls": "excite.identification.estimators.wls:WeightedLeastSquares",
        "robust": "excite.identification.estimators.robust:Huber",
        "map": "excite.identification.estimators.map:MaximumAPosteriori",
        "qp": "excite.identification.estimators.qp:QuadraticProgram",
        "hqp": "excite.identification.estimators.hqp:HierarchicalProgram",
        "cls1": "excite.identification.estimators.cls1:BoundedNearBase",
        "cls2": "excite.identification.estimators.cls2:PhysicallyFeasible",
        "cls3": "excite.identification.estimators.cls3:DensityRealisable",
        "lmi": "excite.identification.estimators.lmi:PhysicallyConsistent",
        "physical": "excite.identification.estimators.physical:PhysicalRetrieval",
    },
)


def find_estimator(name: str) -> Estimator:
    """The estimator of that name; raises UnknownNameError."""
    return ESTIMATORS.make(name)
