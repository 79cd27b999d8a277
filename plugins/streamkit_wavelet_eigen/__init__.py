"""Appearance features of targets: wavelet preprocessing of windows, eigenspaces, and recognition.

All modules but `element` and `featuresink` work on plain arrays and serve as a library by
themselves. The package `experiments` repeats the publication's experiments; no pipeline imports it.
"""
