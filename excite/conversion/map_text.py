"""The ``map.yaml`` that repeats a conversion without guessing, as patterns where columns have one."""

from __future__ import annotations

from collections.abc import Sequence

import yaml

from excite.conversion.columns.families import columns_of
from excite.conversion.guesses import Guesses
from excite.conversion.mapping import SCHEMA, Map
from excite.conversion.trials import Cut
from excite.logs.log import LogHeader


def map_text(found: Guesses, header: LogHeader, cuts: Sequence[Cut], stated: Map) -> str:
    """Text of a ``map.yaml``, a line a field."""
    joints = stated.joints or header.joints
    columns: dict[str, str] = {}
    scale: dict[str, float] = {}
    offset: dict[str, float] = {}
    for channel in dict.fromkeys(item.channel for item in found.mapped):
        items = found.of(channel)
        columns |= columns_of(channel, {item.target: item.source for item in items}, joints)
        factors = {item.factor for item in items}
        if len(factors) == 1 and factors != {1.0}:
            scale[channel] = factors.pop()
        elif len(factors) > 1:
            scale |= {item.target: item.factor for item in items}
        offset |= {item.target: item.offset for item in items if item.offset}
    names = {cut.name for cut in cuts}
    # The last part of a single recording is cut off again by itself.
    validation = [
        cut.name
        for cut in cuts
        if cut.role == "validation" and cut.name.removesuffix("_validation") not in names - {cut.name}
    ]
    lines = [
        f"schema: {SCHEMA}",
        f"joints: {_flow_style(list(joints))}",
        f"columns: {_flow_style(columns)}",
        f"units: {_flow_style(_si_units(found))}",
    ]
    if scale:
        lines.append(f"scale: {_flow_style(scale)}")
    if offset:
        lines.append(f"offset: {_flow_style(offset)}")
    if stated.motors:
        lines.append(f"motors: {_flow_style([list(row) for row in stated.motors])}")
    if stated.ignore:
        lines.append(f"ignore: {_flow_style(list(stated.ignore))}")
    rules = {"validation": validation} if validation else {}
    rules |= stated.trials.model_dump(mode="json", exclude_defaults=True)
    if rules:
        lines.append(f"trials: {_flow_style(rules)}")
    kept = {"torque": header.torque, "modelled": list(header.modelled)} | stated.log
    lines.append(f"log: {_flow_style(kept)}")
    return "\n".join(lines) + "\n"


def _si_units(found: Guesses) -> dict[str, str]:
    """Units of which ``scale`` is one: the factors are all written there."""
    units = {
        "q": "rad",
        "q_cmd": "rad",
        "v": "rad/s",
        "a": "rad/s2",
        "tau": "N·m",
        "tau_cmd": "N·m",
        "i": "A",
        "time": "s",
    }
    return {name: unit for name, unit in units.items() if found.of(name)}


def _flow_style(value: object) -> str:
    return yaml.safe_dump(
        value, default_flow_style=True, sort_keys=False, allow_unicode=True, width=10_000
    ).strip()
