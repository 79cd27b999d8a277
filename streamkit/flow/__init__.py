"""What travels through a graph: frames, their caps, events, metadata, records and the clock."""
