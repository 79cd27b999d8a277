"""Filters of false foreground: shadows, parallax."""
