"""Xu, Fan, Chen, Ng, Ang, Fang, Zhu, Zhao: Dynamic identification of the KUKA LBR iiwa robot with retrieval of
physical parameters using global optimization. IEEE Access 8, 2020."""

from __future__ import annotations

import numpy as np

from excite.identification.parameter_statistics import RSD_ABOVE
from excite.identification.physical.feasible_set import VALUE_BELOW
from excite.regressor.base_parameters import structural_base_parameters
from tests.reproduction.iiwa import bounds, grouping, iiwa, judge, published_base, published_parameters
from tests.reproduction.iiwa_excitation import condition, excitation
from tests.reproduction.iiwa_methods import Identified, identify, largest_residual, rms
from tests.reproduction.iiwa_twins import Recorded, measured_twin, simulated_twin, true_parameters
from tests.reproduction.table import Line, Table

PAPER = "Xu et al. 2020"
OBSERVER_GAIN = 25.0

TABLE_8 = {
    ("base", 1): (0.320, 0.407, 0.205, 0.299, 0.125, 0.122, 0.111, 1.589),
    ("essential", 1): (0.320, 0.407, 0.205, 0.299, 0.125, 0.123, 0.111, 1.589),
    ("physical", 1): (0.330, 0.488, 0.191, 0.383, 0.093, 0.107, 0.117, 1.709),
    ("base", 2): (0.297, 0.288, 0.129, 0.128, 0.076, 0.103, 0.193, 1.215),
    ("essential", 2): (0.297, 0.287, 0.129, 0.128, 0.075, 0.106, 0.193, 1.215),
    ("physical", 2): (0.282, 0.273, 0.114, 0.158, 0.071, 0.069, 0.204, 1.171),
    ("base", 3): (0.378, 0.497, 0.287, 0.274, 0.181, 0.152, 0.230, 1.999),
    ("essential", 3): (0.378, 0.497, 0.287, 0.274, 0.180, 0.152, 0.230, 1.997),
    ("physical", 3): (0.359, 0.475, 0.268, 0.328, 0.157, 0.162, 0.237, 1.985),
}
TABLE_9 = {
    "physical": (0.3299, 0.4878, 0.1905, 0.3826, 0.0933, 0.1070, 0.1174, 1.7085, 75.06),
    "[30]": (0.4977, 0.5087, 0.4117, 0.4706, 0.2850, 0.2506, 0.3412, 2.7656, 143.26),
    "[37]": (0.3314, 0.5110, 0.2112, 0.4674, 0.1175, 0.1174, 0.1429, 1.8989, 82.59),
}
TABLE_10 = {
    "physical": (0.6499, 1.1931, 0.2498, 0.4140, 0.2019, 0.2672, 0.5670),
    "[30]": (0.5546, 1.5307, 0.4706, 0.6224, 0.4203, 0.3563, 0.8164),
    "[37]": (0.6376, 1.2118, 0.2949, 0.7976, 0.3224, 0.3100, 0.5900),
}
JOINTS = tuple(f"joint {k}" for k in range(1, 8))


def tables() -> list[Table]:
    """All tables of the paper that numbers can be put beside."""
    measured, simulated = identify(measured_twin(1)), identify(simulated_twin(1))
    return [
        structure(),
        table_4(),
        elimination(measured),
        retrieval(measured, measured_twin(1)),
        table_8(measured),
        table_9(measured),
        table_10(measured),
        simulation(simulated),
    ]


def structure() -> Table:
    """Numbers of parameters and the excitation."""
    both = structural_base_parameters(iiwa(), ("viscous", "coulomb")).rank
    bodies = structural_base_parameters(iiwa(), ()).rank
    found = condition(excitation())
    return Table(
        f"{PAPER}, sections II.A and IV.B: the problem",
        (
            Line("base parameters", 57, both, both == 57, "57"),
            Line("of them of bodies", 43, bodies, bodies == 43, "43"),
            Line("condition number of the excitation, eq. (9)", 156.3, found, found <= 156.3, "≤ paper"),
        ),
        note="Excitation designed here under eq. (10), with the limits of Table 3.",
    )


def table_4() -> Table:
    """Base parameters of Tables 6 and 7 beside those of Table 4."""
    ours = grouping() @ published_parameters("xu2020")
    lines = tuple(
        Line(
            f"{row.name}{' (regrouped)' if row.regrouped else ''}, RSD {row.base_rsd:g} %",
            row.base,
            float(value),
        )
        for row, value in zip(published_base(), ours, strict=True)
    )
    return Table(
        f"{PAPER}, Table 4: identified base parameters, and those of the physical parameters of Tables 6 and 7",
        lines,
        note=(
            "Ours: Tables 6 and 7 in Khalil's grouping. The large first moments (MY2, MY4, MY6), which gravity "
            "shows, agree to 0.01 kg·m. Inertias and viscous friction (XY2, XZ2, FV1, FV4) do not: the limits of "
            "Tables 6 and 7 and eq. (18) allow no body that has them, as the certificate of the retrieval proves."
        ),
    )


def elimination(found: Identified) -> Table:
    """Tables 4 and 5 on a robot that moves as Table 4 says."""
    names = [row.name for row in published_base()]
    gone = [name for k, name in enumerate(names) if k not in found.essential.kept]
    paper = [row.name for row in published_base() if row.essential is None]
    small = [row.name for row in published_base() if abs(row.base) < VALUE_BELOW and row.base_rsd > RSD_ABOVE]
    lines = [
        Line("essential parameters", len(names) - len(paper), len(found.essential.kept)),
        Line("eliminated", ", ".join(paper), ", ".join(gone)),
        Line(
            "printed with |value| < 0.01 and RSD > 40 % in Table 4",
            ", ".join(paper),
            ", ".join(small),
            small == paper,
            "the same",
        ),
    ]
    lines += [
        Line(f"{row.name}: RSD [%]", row.base_rsd, float(rsd))
        for row, rsd in zip(published_base(), found.base_rsd, strict=True)
        if row.essential is None or row.base_rsd > 20.0
    ]
    left = dict(zip(found.essential.kept.tolist(), found.essential_rsd, strict=True))
    worst = max(
        float(rsd)
        for k, rsd in left.items()
        if abs(found.sets["essential"][published_base()[k].column]) < VALUE_BELOW
    )
    lines.append(
        Line("largest RSD of a small parameter that is left [%]", 40.0, worst, worst <= 40.0, "≤ 40")
    )
    for k, row in enumerate(published_base()):
        if row.essential is not None:
            ours = float(found.sets["essential"][row.column]) if k in left else "eliminated"
            lines.append(Line(f"{row.name}, Table 5", row.essential, ours))
            lines.append(Line(f"{row.name}, Table 5: RSD [%]", row.essential_rsd, left.get(k)))
    return Table(
        f"{PAPER}, Tables 4 and 5: elimination where |value| < 0.01 and RSD > 40 %",
        tuple(lines),
        note=(
            "Torques of Table 4's base parameters along our excitation, with white noise of Table 8's residuals; "
            "values near the thresholds depend on the draw, such as XY5, printed with 0.0098 and 46 %."
        ),
    )


def retrieval(found: Identified, recorded: Recorded) -> Table:
    """Section IV.D: objective, certificate, constraints, time."""
    certificate = found.certificate
    published = found.essential.value(published_parameters("xu2020"))
    broken = judge(found.sets["physical"])
    exact = max(broken["total_mass"], broken["inertia_rules"])
    boxes = max(broken[kind] for kind in ("mass", "com", "inertia", "drive"))
    ours, gap = certificate.objective, 100.0 * certificate.gap
    mass = float(found.sets["physical"][:70:10].sum())
    low, high = bounds().total_mass
    return Table(
        f"{PAPER}, section IV.D: retrieval of physical parameters (eq. 15 to 18)",
        (
            Line("objective of the essential parameters [N·m]", None, found.essential.floor),
            Line("objective at the published solution [N·m]", 75.06, published),
            Line("objective [N·m]", 75.06, ours, ours <= published, "≤ at the published solution"),
            Line("proven lower bound [N·m]", None, certificate.lower_bound),
            Line("gap [%]", None, gap, gap <= 0.1, "≤ 0.1"),
            Line("convex relaxations solved", None, certificate.relaxations),
            Line("objectives of all starts [N·m]", None, ", ".join(f"{f:.4f}" for f in certificate.optima)),
            Line("violation of eq. (16)", None, boxes, boxes == 0.0, "0 exactly"),
            Line("violation of eq. (17) and (18)", None, exact, exact == 0.0, "0 exactly"),
            Line("total mass [kg]", 26.0, mass, low <= mass <= high, "16 … 26"),
            Line("time, one thread [s]", 9854.5, found.seconds, found.seconds < 60.0, "< 60"),
        ),
        note=(
            "Data as for Tables 4 and 5; the published objective is that of the paper's own recording, whose "
            "excitation is another. The lower bound comes from convex relaxations whose multipliers are checked."
        ),
        digits=6,
    )


def table_8(found: Identified) -> Table:
    """RMS of predicted torques along three reference trajectories."""
    lines = []
    for number in (1, 2, 3):
        recorded = measured_twin(number)
        for method in ("base", "essential", "physical"):
            values = rms(recorded, found.sets[method])
            lines += _joint_lines(f"{method}, reference {number}", TABLE_8[method, number], values)
        for method in ("[30]", "[37]", "published", "published [37]"):
            total = float(rms(recorded, found.sets[method]).sum())
            lines.append(Line(f"{_title(method)}, reference {number}: total", None, total))
    return Table(
        f"{PAPER}, Table 8: RMS of torque errors [N·m]",
        tuple(lines),
        note=(
            "Torques of Table 4's base parameters; their residuals of the same table are put in as white noise, so "
            "that the rows of base parameters agree by construction and the others say something. Reference 3 is "
            "not stated in the paper; here it is the excitation at a tenth of its speed."
        ),
    )


def table_9(found: Identified) -> Table:
    """RMS along the excitation, three methods."""
    recorded, lines = measured_twin(1), []
    values = {method: rms(recorded, found.sets[method]) for method in found.sets}
    for method, paper in TABLE_9.items():
        lines += _joint_lines(_title(method), paper[:8], values[method])
        ours = float(np.sqrt(len(recorded.time) * (values[method] ** 2).sum()))
        lines.append(Line(f"{_title(method)}: Fval", paper[8], ours))
    best, other = (float(values[method].sum()) for method in ("physical", "[30]"))
    lines.append(
        Line("total of the proposed method below that of [30]", 2.7656, best, best <= other, f"≤ {other:.3f}")
    )
    for method in ("published", "published [37]"):
        lines.append(Line(f"{_title(method)}: total", None, float(values[method].sum())))
    return Table(
        f"{PAPER}, Table 9: RMS of torque errors of physical parameters from three methods, excitation [N·m]",
        tuple(lines),
        note=(
            "[30]: distance of base parameters as objective; [37]: torques of all base parameters as objective, one "
            "local search from the middle of the bounds; both within the same bounds, as run here. The set that the "
            "paper quotes from [37] is of a robot without payload. Fval contains all base parameters: what [37] "
            "minimises, so that it cannot be beaten there once its search ends at the global optimum, as it does "
            "here. The advantage over [37] that the paper reports does not show."
        ),
    )


def table_10(found: Identified) -> Table:
    """Largest residual of the momentum observer, second reference."""
    recorded, lines = measured_twin(2), []
    for method, paper in TABLE_10.items():
        values = largest_residual(recorded, found.sets[method], OBSERVER_GAIN)
        lines += _joint_lines(_title(method), paper, values, total=False)
    for method in ("base", "essential", "published", "published [37]"):
        values = largest_residual(recorded, found.sets[method], OBSERVER_GAIN)
        lines += _joint_lines(_title(method), (None,) * 7, values, total=False)
    return Table(
        f"{PAPER}, Table 10: largest residual of the momentum observer, reference 2 [N·m]",
        tuple(lines),
        note=(
            f"Gain {OBSERVER_GAIN:g} 1/s, which the paper does not state. What real joints do beyond the friction "
            "model is white noise here, most of which the observer filters out."
        ),
    )


def simulation(found: Identified) -> Table:
    """The same on a robot simulated in MuJoCo."""
    truth, certificate = true_parameters(), found.certificate
    at_truth = found.essential.value(truth)
    broken = max(judge(found.sets["physical"]).values())
    lines = [
        Line("essential parameters", 53, len(found.essential.kept)),
        Line("objective at the truth [N·m]", 75.06, at_truth),
        Line(
            "objective [N·m]",
            75.06,
            certificate.objective,
            certificate.objective <= at_truth,
            "≤ at the truth",
        ),
        Line("gap [%]", None, 100.0 * certificate.gap, certificate.gap <= 5e-3, "≤ 0.5"),
        Line("violation of eq. (16) to (18)", None, broken, broken == 0.0, "0 exactly"),
        Line("time, one thread [s]", 9854.5, found.seconds, found.seconds < 60.0, "< 60"),
    ]
    for number in (1, 2, 3):
        recorded = simulated_twin(number)
        for method in ("base", "essential", "physical", "[30]", "[37]"):
            paper = TABLE_8[method, number][7] if (method, number) in TABLE_8 else None
            total = float(rms(recorded, found.sets[method]).sum())
            lines.append(Line(f"{_title(method)}, reference {number}: total RMS [N·m]", paper, total))
    recorded = simulated_twin(2)
    for method in TABLE_10:
        largest = float(largest_residual(recorded, found.sets[method], OBSERVER_GAIN).max())
        lines.append(
            Line(f"{_title(method)}: largest residual of any joint [N·m]", max(TABLE_10[method]), largest)
        )
    return Table(
        f"{PAPER}, Tables 8 to 10 on a simulated robot",
        tuple(lines),
        note=(
            "MuJoCo, position servo, torque sensors with noise; truth: Tables 6 and 7's solution, moments moved by "
            "at most 1.5e-4 kg·m² to where bodies can exist, friction after the sensors. Whatever the friction "
            "model of a real joint lacks is not there, so that errors are a tenth of the paper's."
        ),
    )


def _joint_lines(title: str, paper: tuple, values: np.ndarray, *, total: bool = True) -> list[Line]:
    lines = [
        Line(f"{title}: {joint}", published, float(value))
        for joint, published, value in zip(JOINTS, paper, values, strict=False)
    ]
    return [*lines, Line(f"{title}: total", paper[7], float(values.sum()))] if total else lines


def _title(method: str) -> str:
    titles = {
        "physical": "proposed",
        "[30]": "method of [30]",
        "[37]": "method of [37]",
        "published": "Tables 6 and 7 as printed",
        "published [37]": "Tables 6 and 7 as printed, column [37]",
    }
    return titles.get(method, method)
