"""Initiation: new targets, and the confirmation of tentative ones.

Contract: `start_appearances(table, ...)` gives confirmed targets a template,
`add_tentative(table, ...)` starts a target on every detection that is left.
"""
