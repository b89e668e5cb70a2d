"""The virtual drive met by other processes and other software, and what went over the wire judged by a decoder of its own."""
