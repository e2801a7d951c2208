"""The estimators by name. A new one is one file beside this one and one line here."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any

from excite.registry import Registry

if TYPE_CHECKING:
    from excite.identification.estimators.estimator import Estimator

# Bodies that can exist, of fixed and floating robots alike, with nothing to be told before; of the methods whose bodies
# exist it alone predicts trials left out as well as least squares on every real arm tried (docs/measured.md).
DEFAULT_METHOD = "adaptive"

ESTIMATORS: Registry[Estimator[Any]] = Registry(
    "method",
    {
        "adaptive": "excite.identification.estimators.conic:Adaptive",
        "ls": "excite.identification.estimators.least_squares:LeastSquares",
        "wls": "excite.identification.estimators.least_squares:WeightedLeastSquares",
        "map": "excite.identification.estimators.least_squares:MaximumAPosteriori",
        "qp": "excite.identification.estimators.conic:QuadraticProgram",
        "hqp": "excite.identification.estimators.hqp:HierarchicalProgram",
        "cls1": "excite.identification.estimators.hqp:BoundedNearBase",
        "cls2": "excite.identification.estimators.conic:PhysicallyFeasible",
        "cls3": "excite.identification.estimators.conic:DensityRealisable",
        "lmi": "excite.identification.estimators.conic:PhysicallyConsistent",
        "physical": "excite.identification.estimators.physical:PhysicalRetrieval",
    },
)


def find_estimator(name: str) -> Estimator[Any]:
    """The estimator of that name; raises UnknownNameError."""
    return ESTIMATORS.make(name)


# What there is to say about each method in a line: what it is, when to take it, what it promises, its
# settings.


@dataclass(frozen=True)
class MethodSummary:
    """A method in a line.

    Attributes:
        name: what one types.
        title: what it is.
        use: when to take it.
        guarantees: what holds for every result that it returns.
        consistent: whether its bodies can exist.
        default: whether it is taken where none is named.
        settings: names of its settings, without those that all methods share.
    """

    name: str
    title: str
    use: str
    guarantees: str
    consistent: bool
    default: bool
    settings: tuple[str, ...]

    def to_json(self) -> dict[str, object]:
        """The fields by name, ready for JSON."""
        return {**asdict(self), "settings": list(self.settings)}


def method_summaries() -> tuple[MethodSummary, ...]:
    """All methods of identification, in the registry's order."""
    shared = set.intersection(
        *({item.name for item in fields(kind.settings_class)} for kind in ESTIMATORS.values())
    )
    return tuple(
        MethodSummary(
            name=name,
            title=kind.title,
            use=kind.use,
            guarantees=kind.guarantees,
            consistent=kind.consistent,
            default=name == DEFAULT_METHOD,
            settings=tuple(item.name for item in fields(kind.settings_class) if item.name not in shared),
        )
        for name, kind in ESTIMATORS.items()
    )
