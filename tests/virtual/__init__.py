"""Tests of the virtual drive: raw frames against CiA 301 and CiA 402."""
