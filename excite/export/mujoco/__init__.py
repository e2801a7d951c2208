"""Motions for MuJoCo: keyframes of any model."""
