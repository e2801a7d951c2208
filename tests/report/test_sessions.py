"""What sessions agree on and what varies between them, on the page of an identification."""

from __future__ import annotations

import json

from excite.report.page import report
from excite.robot.loading import load_robot
from tests.report.sample import sample_folder


def test_what_varies_between_sessions_stands_in_the_open(tmp_path):
    ur10 = load_robot("ur10")
    document = json.loads((sample_folder(tmp_path / "all", ur10) / "campaign.json").read_text())[
        "identification"
    ]
    folder = tmp_path / "days"
    folder.mkdir()
    file = folder / "identification.json"
    session = {"value": 20.0, "std": 0.1}
    steady = {
        "name": "mx(upper_arm_link)",
        "expression": "mx(upper_arm_link)",
        "value": 0.5,
        "between_std": 0.0,
        "varies": False,
        "low": 0.4,
        "high": 0.6,
        "by_session": {"mon": {"value": 0.5, "std": 0.02}, "tue<b>": {"value": 0.5, "std": 0.02}},
    }
    friction = {
        **steady,
        "name": "viscous(elbow_joint)",
        "varies": True,
        "low": 0.0,
        "high": 67.0,
        "by_session": {"mon": session, "tue<b>": {"value": 25.0, "std": 0.1}},
    }
    names = ["mon", "tue<b>"]
    document["sessions"] = {"names": names, "left_out": {}, "level": 0.95, "parameters": [steady, friction]}
    file.write_text(json.dumps(document))
    page = report(folder).read_text()
    block = page[page.index('id="sessions"') :]
    open_part, folded = block[: block.index("<details")], block[block.index("<details") :]
    assert "1 of 2 of the base parameters differs between 2 sessions (mon, tue&lt;b&gt;)" in open_part
    assert "viscous(elbow_joint)" in open_part and "20.0 ± 0.10" in open_part and "0 … 67.0" in open_part
    assert (
        "mx(upper_arm_link)" not in open_part and "mx(upper_arm_link)" in folded[: folded.index("</details>")]
    )
    friction["varies"] = False
    file.write_text(json.dumps(document))
    assert "None of the base parameters differ between 2 sessions" in report(folder).read_text()
