"""Estimates of several estimators by the same settings, of which each takes those that it knows."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from excite.identification.estimators.estimator import Estimate, Estimator
from excite.identification.estimators.method_settings import methods_with
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.problem import IdentificationProblem


def settings_of(estimator: Estimator[Any], values: dict[str, Any]) -> EstimatorSettings:
    """Those of some settings that an estimator knows; each has to be known to some method."""
    assert all(methods_with(name) for name in values), values
    known = {item.name for item in fields(estimator.settings_class)}
    return estimator.settings_class(**{name: value for name, value in values.items() if name in known})


def estimated(estimator: Estimator[Any], problem: IdentificationProblem, **values: Any) -> Estimate:
    """What an estimator finds with those of some settings that it knows."""
    return estimator.estimate(problem, settings_of(estimator, values))
