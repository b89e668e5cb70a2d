"""SYNC from the kernel's broadcast manager, in real time:  cd tests && python -m wire.broadcast can0 [SECONDS]

The kernel sends, python-can only asks it to (``send_periodic``); another socket receives, stamped by the kernel.  The
intervals and the cycles that are missing are reported, for a simulated machine's timer is what it is; that the median is the period and
that no cycle comes twice is judged.
"""

from __future__ import annotations

import itertools
import statistics
import sys
import time

import can

PERIOD_S = 0.010


def stamps(channel: str, seconds: float) -> list[float]:
    """Stamps of the SYNCs that a second socket has received while the kernel sent for so long."""
    found: list[float] = []
    with can.Bus(interface="socketcan", channel=channel) as sender, can.Bus(interface="socketcan", channel=channel) as receiver:
        sync = can.Message(arbitration_id=0x80, is_extended_id=False)
        end_s = time.monotonic() + seconds
        task = sender.send_periodic(sync, PERIOD_S)
        if not type(task).__module__.endswith("socketcan"):
            raise RuntimeError(f"{type(task).__name__} is no task of the kernel's broadcast manager")
        while time.monotonic() < end_s:
            message = receiver.recv(0.1)
            if message is not None and message.arbitration_id == 0x80:
                found.append(message.timestamp)
        task.stop()
    return found


def judged(found: list[float]) -> tuple[list[str], bool]:
    """In words, and whether it was a SYNC every period and none came twice; a timer that was late leaves cycles out, which is told."""
    if len(found) < 2:
        return [f"{len(found)} SYNCs received"], False
    intervals = [1e3 * (b - a) for a, b in itertools.pairwise(found)]
    expected = round((found[-1] - found[0]) / PERIOD_S) + 1
    lost = sum(max(round(interval / (1e3 * PERIOD_S)) - 1, 0) for interval in intervals)
    ordered = sorted(intervals)
    median = statistics.median(intervals)
    return [
        f"{len(found)} SYNCs in {found[-1] - found[0]:.3f} s, {expected} periods of {1e3 * PERIOD_S:g} ms: {lost} cycles lost in gaps, "
        f"{max(expected - len(found) - lost, 0)} by a timer that is late each time, {max(len(found) - expected, 0)} too many",
        f"interval: median {median:.3f} ms, from {ordered[0]:.3f} to {ordered[-1]:.3f} ms, 99 % within "
        f"{ordered[int(0.99 * len(ordered))]:.3f} ms",
    ], 0.5 * expected <= len(found) <= expected + 1 and abs(median - 1e3 * PERIOD_S) < 0.1e3 * PERIOD_S


if __name__ == "__main__":
    lines, right = judged(stamps(sys.argv[1], float(sys.argv[2]) if len(sys.argv) > 2 else 10.0))
    sys.stdout.write("".join(f"{line}\n" for line in lines))
    sys.exit(0 if right else 1)
