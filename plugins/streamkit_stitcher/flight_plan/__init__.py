"""What is known before a flight strip: its length, its frames, and how they are made even."""
