"""What CiA 402 asks of a servo drive at standstill: its state machine, its modes; and that records are whole."""

from __future__ import annotations

from independent.asking import Draw, refusal_of
from independent.master import Master

#: State by the statusword's bits 6, 5, 3, 2, 1, 0 (CiA 402, table 30): mask, value.
_STATES = {
    "switch on disabled": (0x4F, 0x40),
    "ready": (0x6F, 0x21),
    "switched on": (0x6F, 0x23),
    "enabled": (0x6F, 0x27),
    "quick stop": (0x6F, 0x07),
    "fault reaction": (0x4F, 0x0F),
    "fault": (0x4F, 0x08),
}
#: Where a command leads (CiA 402, table 29), by its controlword's low byte.
_NEXT = {
    ("switch on disabled", 0x06): "ready",
    ("ready", 0x07): "switched on",
    ("ready", 0x0F): "enabled",
    ("ready", 0x00): "switch on disabled",
    ("ready", 0x02): "switch on disabled",
    ("switched on", 0x0F): "enabled",
    ("switched on", 0x06): "ready",
    ("switched on", 0x00): "switch on disabled",
    ("switched on", 0x02): "switch on disabled",
    ("enabled", 0x07): "switched on",
    ("enabled", 0x06): "ready",
    ("enabled", 0x00): "switch on disabled",
    ("enabled", 0x02): "switch on disabled",  # at standstill the ramp is over at once; 605Ah 5 to 7 stay
}
SETTLED_S = 0.6


def state_of(master: Master) -> str:
    word = master.read(0x6041)
    return next((name for name, (mask, value) in _STATES.items() if word & mask == value), f"no state: {word:04X}h")


def machine(master: Master, draw: Draw) -> list[str]:
    """A random walk through the state machine at standstill."""
    wrong: list[str] = []
    if master.has(0x6510, 0x10):
        master.write(0x6510, 0x10, 2, 2)
    if master.has(0x605A):
        master.write(0x605A, 0, 2, 2)
    master.write(0x6040, 0, 0x00, 2)
    master.wait(SETTLED_S)
    state = state_of(master)
    for _ in range(14):
        word = int(draw.choice([0x00, 0x02, 0x06, 0x07, 0x0F]))
        master.write(0x6040, 0, word, 2)
        master.wait(SETTLED_S)
        expected, state = _NEXT.get((state, word), state), state_of(master)
        if state != expected:
            wrong.append(f"controlword {word:02X}h led to {state}, not {expected}")
    master.write(0x6040, 0, 0, 2)
    master.wait(SETTLED_S)
    return wrong


def modes(master: Master, draw: Draw) -> list[str]:
    """6061h follows 6060h for what 6502h offers; the rest is refused or has no effect."""
    if not master.has(0x6502):
        return []
    wrong = []
    offered = master.read(0x6502)
    for number in draw.permutation([1, 2, 3, 4, 6, 7, 8, 9, 10]):
        mode = int(number)
        refusal = refusal_of(lambda m=mode: master.write(0x6060, 0, m, 1))
        master.wait(0.01)
        shown = master.read(0x6061, signed=True)
        if offered >> (mode - 1) & 1:
            if refusal or shown != mode:
                wrong.append(f"mode {mode} is offered by 6502h, 6061h is {shown}")
        elif shown == mode:
            wrong.append(f"mode {mode} is not offered by 6502h and is taken")
    refusal_of(lambda: master.write(0x6060, 0, 1, 1))
    return wrong


def factors(master: Master, draw: Draw) -> list[str]:
    """Records tell how many subindices they have, and have them."""
    wrong = []
    for index in (0x607D, 0x6099, 0x608F, 0x6091, 0x6092, 0x60C2, 0x1018, 0x1010):
        if not master.has(index):
            continue
        count = master.read(index)
        for subindex in range(1, count + 1):
            if not master.has(index, subindex) and index != 0x1018:
                wrong.append(f"{index:04X}h has {count} subindices, but not {subindex}")
    return wrong
