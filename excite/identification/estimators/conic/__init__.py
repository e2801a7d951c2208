"""Estimators by cone programs: bodies that exist, within bounds."""
