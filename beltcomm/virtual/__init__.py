"""A servo drive behind a CAN bus: it sees frames and a machine, and shares no protocol code with any adapter."""

from beltcomm.virtual import bare_can as bare_can  # before anything of it imports can
