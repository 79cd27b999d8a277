"""particletrack: tracks moving targets with layered particle filters, many at once.

Algorithm modules work on plain arrays and need nothing of the engine. `tracker.MultiTargetTracker` is the
entry point; `targets` holds the table of targets, on which one module per role works: `predict`, `associate`,
`update`, `initiate`, `delete`, `report`. `appearance` reads windows and holds the templates.
"""
