"""The published protocol on ORL and COIL-20: tables 1 to 4 and figure 3 next to the printed values.

`streamkit experiments` runs it. All modules but `command` work on plain arrays.
"""
