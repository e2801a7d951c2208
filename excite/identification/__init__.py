"""Parameters of a robot from logs."""
