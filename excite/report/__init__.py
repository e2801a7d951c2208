"""Figures, and the page that shows the results of a folder."""
