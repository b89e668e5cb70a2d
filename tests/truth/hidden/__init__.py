"""Virtual toothed-belt axes with hidden effects: draws, sessions, run folders without the answer."""

from truth.hidden.draw import draw
from truth.hidden.folder import write_session
from truth.hidden.machines import Machine

__all__ = ["Machine", "draw", "write_session"]
