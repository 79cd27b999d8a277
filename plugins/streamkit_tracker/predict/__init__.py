"""Prediction: carries every target from the previous frame to the time and the pixels of this one.

Contract: `predict(table, to_previous, step_s)` moves means, covariances, windows, trails and particles; it
reads no pixel and no detection. `constant_velocity` is the method in use.
"""
