"""The text of a first ``robot.yaml``, comments and all."""

from __future__ import annotations

import math

import yaml

from excite.robot.scaffold.draft import Draft

_FREQUENCY = 8.0
"""Natural frequency of the servo that is proposed for the virtual robot [Hz]."""


def render(draft: Draft) -> str:
    """YAML text of a draft; what a person must say is ``null`` behind a comment that starts with FILL IN."""
    blocks = [
        _head(draft),
        _limits(draft),
        _feet(draft),
        _sensors(draft),
        _drives(draft),
        _segments(draft),
        _collision(draft),
    ]
    return "\n".join(line for block in blocks for line in block) + "\n"


def _word(text: object) -> str:
    """A scalar as YAML writes it, quoted where it has to be."""
    return str(
        yaml.safe_dump(text, default_flow_style=True, allow_unicode=True, width=10_000)
        .strip()
        .removesuffix("\n...")
    )


def _head(draft: Draft) -> list[str]:
    lines = [
        "# A first description, derived from the URDF. Search for FILL IN: what is null there only you know.",
        "# Everything else is a proposal with its source; correct it where you know better.",
        "schema: excite.robot/1",
        f"name: {_word(draft.name)}",
        f"title: {_word(draft.title)}",
        "model:",
        f"  path: {_word(draft.urdf)}",
    ]
    if draft.faults:
        lines.append(
            "  # FILL IN: correct these links in the URDF and remove the line, or say why they may stay so."
        )
        lines.append("  acknowledged:")
        lines += [f"    {_word(link)}: null  # {fault}" for link, fault in draft.faults.items()]
    lines.append("  source: null  # FILL IN: whose URDF this is, and which version")
    why = "two or more limbs leave its root" if draft.floating else "its root carries one limb or has no mass"
    lines.append(f"base: {'floating' if draft.floating else 'fixed'}  # guessed: {why}")
    if draft.locked:
        lines.append("# Held still, because other joints mimic them and coupled joints are not modelled.")
        lines.append("locked_joints:")
        lines += [f"  {_word(name)}: {value!r}" for name, value in draft.locked.items()]
    lines += [
        "# Motions start and end here. Free of collision, and balanced if the robot stands.",
        "posture:",
    ]
    lines.append("  joints:" if draft.rest else "  joints: {}")
    lines += [
        f"    {_word(name)}: {value!r}  # near zero, inside its range" for name, value in draft.rest.items()
    ]
    lines.append("  source: zero where the range allows it, not yet confirmed by a person")
    return lines


def _limits(draft: Draft) -> list[str]:
    lines = ["limits:", "  position:"]
    unlimited = [guess for guess in draft.joints if guess.position is None]
    if unlimited:
        lines.append("    joints:")
        for guess in unlimited:
            what = "turns without end; " if guess.continuous else ""
            lines.append(f"      {_word(guess.name)}: null  # FILL IN: {what}[lowest, highest] in rad or m")
    lines += ["    margin: 0.03", "    source: URDF, less a margin of 0.03 rad"]
    for field, known in (
        ("velocity", {g.name: g.velocity for g in draft.joints}),
        ("torque", {g.name: g.torque for g in draft.joints}),
    ):
        missing = [name for name, value in known.items() if value is None]
        if missing:
            unit = "rad/s or m/s" if field == "velocity" else "N·m or N"
            lines += [f"  {field}:  # joints not named keep the URDF's limit", "    joints:"]
            lines += [f"      {_word(name)}: null  # FILL IN: {unit}" for name in missing]
            lines.append(f"    source: null  # FILL IN: where the {field} limits come from")
    lines += ["  acceleration:", "    joints:"]
    lines += [f"      {_word(name)}: {value!r}" for name, value in draft.acceleration.items()]
    lines.append(
        "    source: 30 % of the URDF's torque limit on the largest inertia at the joint, at most 30 rad/s²"
    )
    lines += ["  jerk:", "    joints:"]
    lines += [f"      {_word(name)}: {20 * value!r}" for name, value in draft.acceleration.items()]
    lines.append("    source: so that full acceleration takes 0.05 s to build up")
    return lines


def _feet(draft: Draft) -> list[str]:
    if not draft.floating:
        return []
    lines = [
        "# Links at the ends of limbs that reach lowest; the sole is the rectangle about their lowest 10 mm."
    ]
    if not draft.feet:
        return [
            *lines,
            "feet: null  # FILL IN: no geometry to guess from; name, link, sole, friction, source of each",
        ]
    lines.append("feet:")
    for foot in draft.feet:
        sole = ", ".join(f"[{', '.join(repr(value) for value in corner)}]" for corner in foot.sole)
        lines += [
            f"  - name: {_word(foot.link)}",
            f"    link: {_word(foot.link)}",
            f"    sole: [{sole}]",
            "    friction: null  # FILL IN: Coulomb friction coefficient of the sole on your floor",
            "    source: rectangle about the lowest 10 mm of the link's geometry",
        ]
    return lines


def _sensors(draft: Draft) -> list[str]:
    lines = [
        "sensors:",
        "  rate_hz: null  # FILL IN: sampling rate of the log",
        "  noise_position: null  # FILL IN: standard deviation of a joint angle in rad",
    ]
    if not draft.floating:
        lines += [
            "  joint_torque: null  # FILL IN: link_side (behind the gearbox) or motor_side (currents)",
            "  noise_torque:",
            "    default: null  # FILL IN: standard deviation of a joint torque in N·m",
            "    source: null  # FILL IN: how you know",
        ]
    else:
        lines += [
            "  noise_base_position: null  # FILL IN: standard deviation of the base's position in m",
            "  noise_base_orientation: null  # FILL IN: standard deviation of the base's orientation in rad",
        ]
        if draft.feet:
            lines.append("  wrench:")
        else:
            lines.append(
                "  wrench: null  # FILL IN: a foot_ft in each ankle, or a force_plate below each foot"
            )
        for foot in draft.feet:
            link = _word(foot.link)
            lines += [
                f"    - name: {link}",
                "      kind: foot_ft  # in the ankle; force_plate for a plate in the ground, link: world",
                f"      link: {link}",
                f"      foot: {link}",
                f"      excludes: [{link}]  # links beyond the sensor, whose weight it does not feel",
                "      noise_force: null  # FILL IN: standard deviation in N",
                "      noise_moment: null  # FILL IN: standard deviation in N·m",
            ]
    return [*lines, "  source: null  # FILL IN: data sheets, or a recording of the robot at rest"]


def _drives(draft: Draft) -> list[str]:
    stiffness = {name: value * (2.0 * math.pi * _FREQUENCY) ** 2 for name, value in draft.inertia.items()}
    damping = {name: 2.0 * 0.7 * value * 2.0 * math.pi * _FREQUENCY for name, value in draft.inertia.items()}
    lines = ["# Gains of the joint servos, for simulation only.", "controller:"]
    for field, values in (("kp", stiffness), ("kd", damping)):
        lines += [f"  {field}:", "    joints:"]
        lines += [
            f"      {_word(name)}: {max(float(f'{value:.2g}'), 0.01)!r}" for name, value in values.items()
        ]
        lines.append("    source: a servo of 8 Hz with damping 0.7 on the largest inertia at the joint")
    return lines


def _segments(draft: Draft) -> list[str]:
    if not draft.pairs:
        return []
    lines = [
        "# Left and right links that are each other's mirror image, by name and mass.",
        "segments:",
        "  pairs:",
    ]
    return [*lines, *(f"    - [{_word(left)}, {_word(right)}]" for left, right in draft.pairs)]


def _collision(draft: Draft) -> list[str]:
    lines = ["collision:"]
    if draft.geometry is None or draft.review is None:
        fault = (draft.geometry_fault or "").replace("\n", " ")
        return [
            *lines,
            f"  # The URDF's geometry cannot be used ({fault}).",
            "  geometry: authored",
            "  shapes: null  # FILL IN: a list like {link: forearm, kind: capsule, size: [0.05, 0.3]}",
            "  margin: 0.01",
            "  source: null  # FILL IN: where the shapes come from",
        ]
    review = draft.review
    lines.append(f"  geometry: {draft.geometry}")
    lines.append("  margin: 0.01")
    if not draft.floating:
        lines.append("  # table_height: 0.0  # a surface below the base, if there is one")
    if review.rest_collisions:
        lines.append("  # CHECK: closer than the margin in the posture above; change the posture:")
        lines += [f"  #   {first} and {second}" for first, second in review.rest_collisions]
    lines.append("  ignored_pairs:" if review.ignored else "  ignored_pairs: []")
    for pairs, why in (
        (review.always, "closer than the margin in nearly every posture"),
        (review.at_rest, "neighbours closer than the margin in the posture above"),
        (review.never, "neighbours that cannot come near each other"),
    ):
        if pairs:
            lines.append(f"    # {why}")
            lines += [f"    - [{_word(first)}, {_word(second)}]" for first, second in pairs]
    lines.append(
        "  source: convex hulls of the URDF's meshes; pairs computed by excite.robot.shapes.ignored_pairs"
    )
    return lines
