"""Plane and earth geometry on plain numpy arrays: a library by itself, which needs nothing of the engine."""
