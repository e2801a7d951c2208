"""Diagnosis of fixed-base logs with joint torques."""
