"""Injected effects of readings and drives."""
