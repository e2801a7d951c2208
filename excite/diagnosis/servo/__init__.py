"""Diagnosis of logs without torque: positions, commands and what is known of the servo."""
