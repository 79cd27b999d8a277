"""Bins that run in processes of their own: where the graph is cut, the child processes, and their end."""
