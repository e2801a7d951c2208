"""A small hand-written arm, and ways to spoil it."""

from __future__ import annotations

ARM = """<?xml version="1.0"?>
<robot name="small">
  <link name="world"/>
  <link name="upper">
    <inertial>
      <origin xyz="0 0 0.2" rpy="0 0 0"/>
      <mass value="2.0"/>
      <inertia ixx="0.03" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.004"/>
    </inertial>
    <collision>
      <origin xyz="0 0 0.2" rpy="0 0 0"/>
      <geometry><cylinder radius="0.05" length="0.3"/></geometry>
    </collision>
  </link>
  <link name="lower">
    <inertial>
      <origin xyz="0 0 0.15" rpy="0 0 0"/>
      <mass value="1.0"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.002"/>
    </inertial>
    <collision>
      <origin xyz="0 0 0.15" rpy="0 0 0"/>
      <geometry><box size="0.06 0.06 0.25"/></geometry>
    </collision>
  </link>
  <link name="tool"/>
  <joint name="shoulder" type="revolute">
    <parent link="world"/>
    <child link="upper"/>
    <origin xyz="0 0 0.1" rpy="0 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="1.5" velocity="2.0" effort="50"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper"/>
    <child link="lower"/>
    <origin xyz="0 0 0.4" rpy="0 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-2.0" upper="2.0" velocity="3.0" effort="20"/>
  </joint>
  <joint name="mount" type="fixed">
    <parent link="lower"/>
    <child link="tool"/>
    <origin xyz="0 0 0.3" rpy="0 0 0"/>
  </joint>
</robot>
"""

ELBOW_AXIS = '<origin xyz="0 0 0.4" rpy="0 0 0"/>\n    <axis xyz="0 1 0"/>'
ELBOW_LIMIT = '<limit lower="-2.0" upper="2.0" velocity="3.0" effort="20"/>'


def spoiled(old: str, new: str) -> str:
    """The arm with one passage replaced; the passage must be there exactly once."""
    if ARM.count(old) != 1:
        raise ValueError(f"{old!r} occurs {ARM.count(old)} times")
    return ARM.replace(old, new)


def chain(n_links: int) -> str:
    """A chain of that many links with mass."""
    inertial = (
        '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    links = "".join(f'<link name="l{i}">{inertial}</link>' for i in range(n_links))
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for i in range(n_links - 1)
    )
    return f'<robot name="chain">{links}{joints}</robot>'
