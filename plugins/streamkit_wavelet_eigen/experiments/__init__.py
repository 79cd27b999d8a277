"""The published protocol: ORL and COIL-20, tables 1 to 4 and figure 3, side by side with the printed values.

`streamkit experiments` runs it. `protocol`, `published`, `recognition`, `selection` and `peers` work on plain
arrays; `tracking` runs the tracker in a pipeline.
"""
