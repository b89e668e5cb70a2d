"""beltcomm commissions toothed-belt linear axes: identify, fit, friction, design, verify.

The public functions are collected in :mod:`beltcomm.api`; importing this package loads nothing else.
"""

__version__ = "0.2.0"
