"""excite: design, check, run and evaluate the experiments that identify a robot's dynamics."""

__version__ = "0.1.0"
