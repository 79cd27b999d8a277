"""Planning of a flight strip, and rectification of its frames."""
