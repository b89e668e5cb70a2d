"""Torque path and torque noise as the motion shows them: values, choice between setpoint and reading, colours."""
