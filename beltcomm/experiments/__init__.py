"""Experiments on a machine: the plan, each record, the sequences, the whole commissioning."""
