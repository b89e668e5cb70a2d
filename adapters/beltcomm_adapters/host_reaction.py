"""Reaction of a drive whose host falls silent: error behaviour 1029h of the node (CiA 301), abort connection option 6007h (CiA 402)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from beltcomm.errors import ObjectRefused
from beltcomm_adapters.sdo import Lending, Objects

#: 1029h:1, of the node after a communication error: pre-operational, its PDOs end; no change; stopped, where it answers no SDO either.
PRE_OPERATIONAL, NO_CHANGE, STOPPED = 0, 1, 2
#: 6007h, of the axis: nothing, fault, disable voltage, quick stop.
NOTHING: Final = 0
#: Tried in this order where nothing would happen.
STOPS: Final = (3, 2, 1)
NODE_WORDS: Final = {
    PRE_OPERATIONAL: "the node then leaves Operational, so its PDOs end",
    NO_CHANGE: "the node stays Operational",
    STOPPED: "the node then stops and answers nothing but NMT",
}
AXIS_WORDS: Final = {0: "nothing happens to the axis", 1: "it goes into fault", 2: "its voltage is taken away", 3: "it makes a quick stop"}


def _behaviour(objects: Objects) -> tuple[int | None, int | None]:
    """1029h:1 and 6007h; None where the drive has none or does not tell."""
    found = []
    for index, subindex, kind in ((0x1029, 1, "uint8"), (0x6007, 0, "int16")):
        try:
            found.append(objects.read_if_there(index, subindex, kind))
        except ObjectRefused:
            found.append(None)
    return found[0], found[1]


def heed(objects: Objects, lending: Lending, stated: Mapping[str, int]) -> None:
    """Have the axis stopped, and the node asked afterwards, where its settings say otherwise.   What is refused shows in the proof.

    Parameters
    ----------
    objects : Objects
    lending : Lending
    stated : mapping of str to int
        Error behaviour by a profile.
    """
    node, axis = _behaviour(objects)
    if node == STOPPED or "node" in stated:
        lending.set_if_there(0x1029, 1, "uint8", stated.get("node", NO_CHANGE))
    if "axis" in stated and lending.set_if_there(0x6007, 0, "int16", stated["axis"]):
        return
    if axis == NOTHING:
        for option in STOPS:
            if lending.set_if_there(0x6007, 0, "int16", option):
                return


def needs_lending(objects: Objects) -> bool:
    """True if :func:`heed` would change something.

    Parameters
    ----------
    objects : Objects
    """
    node, axis = _behaviour(objects)
    return node == STOPPED or axis == NOTHING


def words(objects: Objects) -> str:
    """Reaction of a drive to the loss of its host, in half a sentence; "" where it tells nothing.

    Parameters
    ----------
    objects : Objects
    """
    node, axis = _behaviour(objects)
    said = []
    if node is not None:
        said.append(f"{NODE_WORDS.get(node, 'the node does what its maker chose')} (1029h:1 = {node})")
    if axis is not None:
        said.append(f"{AXIS_WORDS.get(axis, 'the axis does what its maker chose')} (6007h = {axis})")
    return " and ".join(said)
