"""What is known before a flight strip: its length, its pictures, and how they are made even."""
