"""Codecs, one a format: read and written, limits on size and damage handled once, for every kind of user."""
