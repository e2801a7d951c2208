"""The estimators by name. A new one is one file beside this one and one line here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from excite.registry import Registry

if TYPE_CHECKING:
    from excite.identification.estimators.base import Estimator

# Bodies that can exist, of fixed and floating robots alike, with nothing to be told before; of the methods whose bodies
# exist it alone predicts trials left out as well as least squares on every real arm tried (docs/measured.md).
DEFAULT_METHOD = "adaptive"

ESTIMATORS: Registry[Estimator[Any]] = Registry(
    "method",
    {
        "adaptive": "excite.identification.estimators.conic.adaptive:Adaptive",
        "ls": "excite.identification.estimators.least_squares.ls:LeastSquares",
        "wls": "excite.identification.estimators.least_squares.wls:WeightedLeastSquares",
        "robust": "excite.identification.estimators.least_squares.robust:Huber",
        "map": "excite.identification.estimators.least_squares.map:MaximumAPosteriori",
        "qp": "excite.identification.estimators.quadratic.qp:QuadraticProgram",
        "hqp": "excite.identification.estimators.quadratic.hqp:HierarchicalProgram",
        "cls1": "excite.identification.estimators.quadratic.cls1:BoundedNearBase",
        "cls2": "excite.identification.estimators.conic.cls2:PhysicallyFeasible",
        "cls3": "excite.identification.estimators.conic.cls3:DensityRealisable",
        "lmi": "excite.identification.estimators.conic.lmi:PhysicallyConsistent",
        "physical": "excite.identification.estimators.physical:PhysicalRetrieval",
    },
)


def find_estimator(name: str) -> Estimator[Any]:
    """The estimator of that name; raises UnknownNameError."""
    return ESTIMATORS.make(name)
