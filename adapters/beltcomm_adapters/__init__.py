"""Drive adapters: guests of beltcomm, found by entry point (group ``beltcomm.adapters``), never imported by it.

canopen          the drive on any CAN bus, real (opened by buses) or virtual
identification   who answers, what it can do             profiles     what a kind of drive is like: configs/drives/*.yaml
preparation      before an axis may move: checks, mode, limits, watchdog
motion           a motion from enabling to standstill: rows, watched limits, losses        setpoints    its frames
exchange         the cyclic exchange: SYNC, setpoints out, samples in                      interrupts   Ctrl-C while stopping
busload          the period of the exchange that fits the bit rate                         locks        what is never written
gains, scaling   named parameters, and SI units of a drive's raw numbers
cia402           states, control words, faults           sdo          objects by number, values lent and given back
link             one node on one bus: frames, emergencies, signs of life
virtual          the same drive on the virtual bus       serial       RS-232, not built yet
"""
