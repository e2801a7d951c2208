"""Injected effects of forces and contacts."""
