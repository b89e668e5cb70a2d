"""Drive adapters: guests of beltcomm, found by entry point (group ``beltcomm.adapters``), never imported by it.

canopen          the drive on any CAN bus, real (opened by buses) or virtual
serial           the drive at its RS-232 port (serial_drive): serial_line, serial_objects, its own strokes in serial_strokes and serial_run
object_drive     what both have in common: values, parameters, saving, giving back
identification   who answers, what it can do             profiles     what a kind of drive is like: configs/drives/*.yaml
preparation      before an axis may move: checks, mode, limits, watchdog
motion           a motion from enabling to standstill: rows, losses, guarding            setpoints    its frames
watch            its limits on the host
exchange         the cyclic exchange: SYNC, setpoints out, samples in                      interrupts   Ctrl-C while stopping
busload          the period of the exchange that fits the bit rate                         locks        what is never written
gains, scaling   named parameters, and SI units of a drive's raw numbers
cia402           states, control words, faults           sdo          objects by number, values lent and given back
examination      what `beltcomm doctor` looks at
link             one node on one bus: frames, emergencies, signs of life
virtual          the same drive on the virtual bus, for other processes, too       virtual_serial   ... at its virtual RS-232 port
synctime         the host's clock where a drive's time is the count of SYNCs
"""

from beltcomm.virtual import bare_can as bare_can  # before anything of it imports can
