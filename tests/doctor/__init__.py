"""Tests of ``beltcomm doctor``: broken set-ups, what it leaves alone, bad answers."""
