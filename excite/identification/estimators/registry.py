"""The estimators by name; adding one takes its file and a line here."""

from __future__ import annotations

from typing import Any

from excite.errors import UnknownNameError
from excite.identification.estimators.base import Estimator
from excite.identification.estimators.cls1 import BoundedNearBase
from excite.identification.estimators.cls2 import PhysicallyFeasible
from excite.identification.estimators.cls3 import DensityRealisable
from excite.identification.estimators.hqp import HierarchicalProgram
from excite.identification.estimators.lmi import PhysicallyConsistent
from excite.identification.estimators.ls import LeastSquares
from excite.identification.estimators.map import MaximumAPosteriori
from excite.identification.estimators.physical import PhysicalRetrieval
from excite.identification.estimators.qp import QuadraticProgram
from excite.identification.estimators.robust import Huber
from excite.identification.estimators.wls import WeightedLeastSquares

# Parameters of bodies near the nominal model, of fixed and floating robots alike, with nothing to be told before.
DEFAULT_METHOD = "qp"

ESTIMATORS: dict[str, type[Estimator[Any]]] = {
    estimator.name: estimator
    for estimator in (
        LeastSquares,
        WeightedLeastSquares,
        Huber,
        MaximumAPosteriori,
        QuadraticProgram,
        HierarchicalProgram,
        BoundedNearBase,
        PhysicallyFeasible,
        DensityRealisable,
        PhysicallyConsistent,
        PhysicalRetrieval,
    )
}


def find_estimator(name: str) -> Estimator[Any]:
    """The estimator of that name; raises UnknownNameError."""
    if name not in ESTIMATORS:
        raise UnknownNameError("method", name, sorted(ESTIMATORS))
    return ESTIMATORS[name]()
