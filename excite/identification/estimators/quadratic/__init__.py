"""Estimators by quadratic programs: their solvers, and the hierarchies of levels that they solve."""
