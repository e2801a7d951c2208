"""Dynamics and their regressors, base parameters, gradients."""
