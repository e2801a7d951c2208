"""A campaign's folder: its iterations are reported together."""

from __future__ import annotations

import json
import shutil

from excite.report.folder import read_folder
from excite.report.page import render
from tests.report.sample import sample_folder


def test_iterations_are_added_up(g1, tmp_path):
    source = sample_folder(tmp_path / "source", g1, n_motions=1)
    campaign = tmp_path / "campaign"
    for number in (1, 2):
        inside = campaign / f"iteration_{number}"
        inside.mkdir(parents=True)
        shutil.copytree(source / "motions", inside / "motions")
        shutil.copy(source / "plan.json", inside)
        check = json.loads((source / "check.json").read_text())
        check["safe"] = check["motions"][0]["safe"] = number == 1
        (inside / "check.json").write_text(json.dumps(check))
    shutil.copy(source / "campaign.json", campaign)

    findings = read_folder(campaign)
    assert findings.plan["candidates"] == {
        "generated": 280,
        "accepted": 236,
        "rejected": {"self_collision": 34, "zmp": 8, "time_limit": 2},
    }
    assert [entry["motion"] for entry in findings.plan["selected"]] == [
        "iteration_1/motions/motion_00.parquet",
        "iteration_2/motions/motion_00.parquet",
    ]
    assert len(findings.motions) == 2
    assert "conditioning" not in findings.plan
    assert findings.plan["stages"][0] == {"stage": "generate", "seconds": 6.4}
    assert not findings.check["safe"]
    assert "236 of 280" in render(findings) and "1 of 2" in render(findings)
