"""The sections in the order of the page. A new one is one file beside this one and one line here."""

from __future__ import annotations

from excite.report.sections.answer import Answer
from excite.report.sections.assumed import Assumed
from excite.report.sections.certainty import Certainty
from excite.report.sections.diagnosed.baseline import Baseline
from excite.report.sections.diagnosed.budget import BudgetByChannel
from excite.report.sections.diagnosed.curves import Curves
from excite.report.sections.diagnosed.effects import Effects
from excite.report.sections.diagnosed.gap import GapByChannel
from excite.report.sections.diagnosed.record import Record
from excite.report.sections.diagnosed.trivial import Trivial
from excite.report.sections.diagnosed.verdict import Verdict
from excite.report.sections.diagnosed.where import Where
from excite.report.sections.differences import Differences
from excite.report.sections.doctored.beside_model import TorquesBesideModel
from excite.report.sections.doctored.findings import LogFindings
from excite.report.sections.excitation import Excitation
from excite.report.sections.forces import Forces
from excite.report.sections.masses import Masses
from excite.report.sections.motions import Motions
from excite.report.sections.moving import Moving
from excite.report.sections.overview import Overview
from excite.report.sections.parameters import Parameters
from excite.report.sections.person import Person
from excite.report.sections.refused import Refused
from excite.report.sections.safety import Safety
from excite.report.sections.section import Section
from excite.report.sections.sessions import Sessions
from excite.report.sections.signals import Signals
from excite.report.sections.stages import Stages

SECTIONS: tuple[Section, ...] = (
    Answer(),
    Verdict(),
    Overview(),
    LogFindings(),
    TorquesBesideModel(),
    Moving(),
    Effects(),
    BudgetByChannel(),
    GapByChannel(),
    Trivial(),
    Where(),
    Baseline(),
    Curves(),
    Record(),
    Motions(),
    Refused(),
    Safety(),
    Assumed(),
    Excitation(),
    Certainty(),
    Forces(),
    Masses(),
    Person(),
    Differences(),
    Parameters(),
    Sessions(),
    Signals(),
    Stages(),
)
