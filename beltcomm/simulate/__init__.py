"""Simulation of a model: the laws of its effects composed into one compiled kernel, forward and inverse."""
