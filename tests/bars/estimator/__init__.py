"""Bars of the estimator: measured by name."""
