"""Least squares of rows, plain, weighted, robust, and with the nominal model as a prior."""
