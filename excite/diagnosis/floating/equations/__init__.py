"""The wrench equations of a free base: record, state under a hypothesis, derivatives, fit."""
