"""What an identification comes to."""

from __future__ import annotations

from statistics import median

from excite.identification.judgement.poor import POOR_RSD
from excite.report.conclusions.result import Conclusion, log_words, robot_name, robot_words
from excite.report.doubt import describe_doubt
from excite.report.folder import Document, Findings
from excite.shown import count


def of_identification(found: Document, findings: Findings) -> Conclusion:
    """Of ``identification.json``."""
    base = found["base_parameters"]
    verb = "was" if len(base) == 1 else "were"
    known = f"{count(len(base), 'base parameter')} {verb} identified from {found['n_samples']} samples"
    judged = [r for r in found["validation"].values() if r["reference_rmse"] and r["rmse"] is not None]
    if not judged:
        return Conclusion(
            f"{known}; no trial was left out to judge them, so nobody knows how good they are.",
            None,
            ("identify", robot_words(findings), log_words(found, findings), "--out", findings.folder),
            "again, with a trial of the role validation in log.yaml",
        )
    better = sum(row["rmse"] < row["reference_rmse"] for row in judged)
    change = median(row["rmse"] / row["reference_rmse"] for row in judged) - 1.0
    predicted = (
        f"on trials that they were not fitted to, {better} of {len(judged)} channels are predicted better than by the "
        f"nominal model (error {100.0 * change:+.0f} %, median channel)".replace("-", "−")
    )
    if better < len(judged) or not found["solved"]:
        solved = "" if found["solved"] else ", and the solver did not end well"
        return Conclusion(
            f"{known}, but {predicted}{solved}: not to be used before that is understood.",
            False,
            ("doctor", log_words(found, findings)),
            "see what is wrong with the record",
        )
    rsd = [row["rsd_percent"] for row in base]
    vague = sum(value is None or value > POOR_RSD for value in rsd)
    single = f"{vague} of {len(rsd)} parameters by themselves are not known to within {POOR_RSD:.0f} %"
    said = f"{known}; {predicted}"
    why = describe_doubt(found, len(judged))
    if why:
        command = ("diagnose", log_words(found, findings), "--out", "diagnosis")
        return Conclusion(f"{said}, but {why}.", False, command, "see what the model lacks")
    single = f", though {single}" if vague else ""
    if any(finding["kind"] == "extension" for finding in found["findings"]):
        more = "more than bodies and friction is in the torques"
        command = ("diagnose", log_words(found, findings), "--out", "diagnosis")
        return Conclusion(
            f"{said}: good enough to predict motions like these{single}; but {more}.",
            True,
            command,
            "see what it is",
        )
    return Conclusion(
        f"{said}: good enough to predict motions like these{single}.", True, *model_command(findings)
    )


def model_command(findings: Findings) -> tuple[tuple[object, ...], str]:
    """The command that takes it into a simulator, and what for."""
    command = ("model", findings.folder, "--format", "mjcf", "--out", f"{robot_name(findings)}_mujoco")
    return command, "take the identified robot into a simulator"
