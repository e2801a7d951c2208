"""Motions for controllers, and identified robots for simulators."""
