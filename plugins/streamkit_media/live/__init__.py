"""Live sources: connections that are made again, watched from outside, and never fall behind."""
