"""Settings of a method by its name, and the refusal of those that it does not know."""

from __future__ import annotations

from dataclasses import Field, fields
from typing import Any, NoReturn

import numpy as np

from excite.errors import InputError, UnknownNameError
from excite.identification.estimators.estimator import Estimator
from excite.identification.estimators.registry import ESTIMATORS, find_estimator
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.physical.bounds import KnownBounds
from excite.rows.settings import SOURCE


def estimator_settings(method: str, **values: Any) -> EstimatorSettings:
    """Settings of a method; what is left out has its default.

    Args:
        method: registry name of the estimator.
        values: settings by name, such as ``alpha=2.0``; ``excite identify --help`` and ``docs/methods.md`` list them.

    Returns:
        An object of the method's own class, such as ``QpSettings``, which says unit and meaning of each.

    Raises:
        UnknownNameError: no such method, or a setting that no method knows.
        InputError: a setting that this method does not know, though others do, or a value out of its bounds.
    """
    kind = find_estimator(method).settings_class
    known = [item.name for item in fields(kind)]
    for name, value in values.items():
        if name not in known:
            _refuse_setting(name, value, method)
    return kind(**values)


def own_settings(estimator: Estimator[Any], settings: EstimatorSettings | None) -> EstimatorSettings:
    """Settings of an estimator's own class, with all that was set in another class.

    Settings that all methods share can thus be stated once for several methods.

    Args:
        settings: of any class; None for defaults.

    Raises:
        InputError: one that was set, that is differs from its default, is not known to the estimator.
    """
    kind = estimator.settings_class
    if type(settings) is kind:
        return settings
    given = () if settings is None else fields(settings)
    values = {item.name: getattr(settings, item.name) for item in given}
    changed = {item.name: values[item.name] for item in given if not _is_default(item, values[item.name])}
    return estimator_settings(estimator.name, **changed)


def methods_with(setting: str) -> tuple[str, ...]:
    """Methods that know a setting, in the registry's order."""
    return tuple(
        name
        for name, kind in ESTIMATORS.items()
        if setting in (item.name for item in fields(kind.settings_class))
    )


def _is_default(item: Field[Any], value: Any) -> bool:
    if isinstance(value, np.ndarray):
        return False
    # Settings without a default are mappings, whose default is an empty one.
    return bool(value == item.default) if item.default_factory is not dict else not value


def _refuse_setting(name: str, value: Any, method: str) -> NoReturn:
    able = methods_with(name)
    if not able:
        known = {item.name for kind in ESTIMATORS.values() for item in fields(kind.settings_class)}
        raise UnknownNameError("setting", name, sorted(known))
    source = value.source if isinstance(value, KnownBounds) else SOURCE
    choices = able[0] if len(able) == 1 else "one of " + ", ".join(able)
    raise InputError(
        f"is not used by method {method!r}",
        source=source,
        field=name,
        remedy=f"choose {choices}, or leave it out",
    )
