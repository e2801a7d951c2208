"""Whose a column is, by what its name and those of the robot's joints have in common."""
