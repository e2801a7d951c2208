"""Mutation testing: do the tests notice when a line of the code is changed? ``docs/mutation.md`` says how it went."""
