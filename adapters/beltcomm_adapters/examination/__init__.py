"""``beltcomm doctor`` for CAN and serial drives: checks as values in lists, one file per area.

A check is a function from a small context to findings; it reads, and moves nothing.

surroundings     interfaces, ports, permissions and drivers of this machine          host      what of it is read
can              a CAN drive step by step: the order of all that follows
wire             the bus: does it open, is anybody there, at which bit rate          errors    error frames in words
patient          the context of a drive's checks, and how a list of them is run
node             who answers, NMT state, answering times                             condition faults, error history, temperature
enabling         what the power stage waits for                                      units     scaling, ratings, modes, sync period
place            where the axis stands        watching   what the drive supervises   timing    SYNC and its answers, when asked for
line             a drive on RS-232
"""
