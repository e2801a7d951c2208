"""``excite.identification/1``: identified parameters, their quality, how well they predict."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from excite.documents.document import (
    AS_DOCUMENT,
    MOST_CHANNELS,
    MOST_ENTRIES,
    NONE,
    Block,
    Count,
    Document,
    FilePath,
    Findings,
    Maybe,
    MaybePositive,
    Name,
    Names,
    Text,
    Texts,
    Vector3,
    Vector6,
)
from excite.identification.changed_segments import ChangedSegment
from excite.identification.judgement.judgement import ChannelFit, Consistency, TotalMassReport
from excite.identification.parameter_statistics import BaseParameter
from excite.identification.sessions.compare import Sessions


class Inertial(Block):
    """Ten inertial parameters, or something said of each of them, about the joint frame's origin."""

    mass: Maybe = Field(default=None, description="[kg]")
    first_moment: Vector3 | None = Field(default=None, description="mass times centre of mass [kg·m]")
    inertia: Vector6 | None = Field(default=None, description="Ixx, Iyy, Izz, Ixy, Ixz, Iyz [kg·m²]")


class SegmentParameters(Inertial):
    """Identified parameters of a segment, and what belongs to them."""

    mass: Maybe = Field(description="[kg]")
    first_moment: Vector3 = Field(description="mass times centre of mass [kg·m]")
    inertia: Vector6 = Field(description="Ixx, Iyy, Izz, Ixy, Ixz, Iyz [kg·m²]")
    name: Name | None = Field(default=None, description="readable name of the segment")
    nominal_mass: Maybe = Field(default=None, description="mass in the model [kg]")
    nominal: Inertial | None = Field(default=None, description="parameters of the model")
    std: Inertial | None = Field(default=None, description="standard deviations, same units")
    determined: Inertial | None = Field(
        default=None, description="share of the model's uncertainty that the data took away, 0 to 1"
    )


Fits = Annotated[Mapping[Name, ChannelFit], AS_DOCUMENT]


class TorqueDelay(Block):
    """How late torques were logged."""

    value_s: Maybe = Field(description="delay against the positions [s]")
    std_s: MaybePositive = Field(default=None, description="its standard deviation [s]")


class Identification(Document):
    """Identified parameters, their quality, how well they predict."""

    schema_: Literal["excite.identification/1"] = Field(
        alias="schema", description="version of this document"
    )
    robot: Name = Field(description="name of the robot")
    robot_file: FilePath | None = Field(
        default=None,
        description="robot.yaml or model of a robot of one's own, relative to this document's folder",
    )
    log_file: FilePath | None = Field(
        default=None, description="the log, or the first of several, relative to this document's folder"
    )
    method: Name = Field(description="estimator")
    status: Text | None = Field(default=None, description="advice on how the solve ended")
    solved: bool = Field(default=True, description="whether the estimator's answer passed its recomputation")
    n_samples: Count = Field(description="number of instants that were used")
    standard_parameters: Annotated[dict[Name, SegmentParameters], Field(max_length=MOST_CHANNELS)] = Field(
        description="by link"
    )
    drive_parameters: Annotated[dict[Name, Maybe], Field(max_length=MOST_ENTRIES)] = Field(
        default={}, description="parameters of the drives by name [SI]"
    )
    base_parameters: Annotated[tuple[BaseParameter, ...], AS_DOCUMENT] = Field(description="base parameters")
    n_structural_base_parameters: Count | None = Field(
        default=None, description="number that free motion would determine; null where it is not known"
    )
    essential: Annotated[tuple[BaseParameter | str, ...], AS_DOCUMENT] = Field(
        description="base parameters left after the negligible ones were removed, or their names"
    )
    consistency: Annotated[Consistency | None, AS_DOCUMENT] = Field(
        description="physical consistency of the parameters"
    )
    fit: Fits = Field(description="by channel, on the trials that were identified from")
    validation: Fits = Field(description="by channel, on the trials that were not")
    changed_segments: Annotated[tuple[ChangedSegment, ...], AS_DOCUMENT] = Field(
        default=NONE, description="segments that are not what the model says"
    )
    total_mass: Annotated[TotalMassReport | None, AS_DOCUMENT] = Field(
        default=None, description="the total mass from all sides"
    )
    sessions: Annotated[Sessions | None, AS_DOCUMENT] = Field(
        default=None, description="null where no sessions were pooled"
    )
    torque_delay: TorqueDelay | None = Field(default=None, description="null where it was not looked for")
    unmeasured: Names = Field(default=[], description="links that the sensors do not see")
    warnings: Texts = Field(description="what a careful reader should know, one sentence each")
    findings: Findings = Field(default=NONE, description="the warnings with their figures")
