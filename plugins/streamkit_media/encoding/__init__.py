"""Frames to coded packets and to H.264 files."""
