"""Tuning by hand: from the three knobs to gains, curves and numbers, fast enough for sliders; values to values, no I/O."""
