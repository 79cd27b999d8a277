"""Queues by which frames and work change threads, which count what they lose; processes and their parents."""
