"""Appearance: reading windows out of a frame, templates, and the filter that finds a target drawn by hand."""
