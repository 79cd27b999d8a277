"""Recording of packets as received, one file per frame, and replay of a recording."""
