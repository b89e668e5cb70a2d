"""The drive's torque path by setpoint and reading: from the setpoint to the torque that acts, and from there to the reading."""
