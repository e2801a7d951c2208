"""Logs of simulated robots with hidden differences, and the comparison of diagnoses with what was hidden."""
