"""Coded packets to frames."""
