"""Filters of false foreground: shadows, flicker, ghosts, parallax."""
