"""Appearance features of targets: wavelet preprocessing of windows, eigenspaces, and recognition.

In the order of a frame: `windows` cuts the targets out, `preprocessing` prepares them, a `feature_space`
projects them, and `gallery` gives them names. `appearance` joins these steps and learns the space from the
stream, `recipe` holds their settings, `model_file` saves them. All modules but `element` and `featuresink`
work on plain arrays and serve as a library by themselves. The package `experiments` repeats the published
experiments; no pipeline imports it.
"""
