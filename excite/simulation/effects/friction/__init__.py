"""Injected effects of friction in the joints."""
