"""A servo drive behind a CAN bus: it sees frames and a machine, and shares no protocol code with any adapter."""
