"""Uncertainty of a fitted model: 95 % intervals, nuisance parameters, remarks in words."""
