"""Deletion: ends targets that are gone, duplicates, and those beyond `max_targets`.

Contract: each function sets the state LOST and the cause; the tracker drops the rows after they are reported.
"""
