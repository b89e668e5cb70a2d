"""Compares a model with measurements, finds the effect that is missing, and adds it."""
