"""Logs with motor currents: torque constants, then the diagnosis of the torques that they make."""
