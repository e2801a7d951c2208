"""Diagnosis of floating-base logs: contact wrenches predicted at the base against measured ones."""
