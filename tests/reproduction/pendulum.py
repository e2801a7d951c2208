"""The model of a servo with a weight on an arm, hanging at zero."""

from __future__ import annotations


def pendulum_urdf(name: str, joint: str, mass: float, length: float, effort: float, velocity: float) -> str:
    """A URDF of a point mass [kg] at a distance [m]; effort [N·m] and velocity [rad/s] are the servo's limits."""
    return f"""<robot name="{name}">
  <link name="bench"/>
  <link name="pendulum">
    <inertial><origin xyz="0 0 -{length}"/><mass value="{mass}"/>
      <inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="{joint}" type="revolute">
    <parent link="bench"/><child link="pendulum"/><axis xyz="0 -1 0"/>
    <limit lower="-3.2" upper="3.2" effort="{effort:g}" velocity="{velocity:g}"/>
  </joint>
</robot>
"""
