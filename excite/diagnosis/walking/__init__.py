"""Diagnosis of a robot that walks: what its servos, its limbs, its IMU and its feet are not as simulated."""
