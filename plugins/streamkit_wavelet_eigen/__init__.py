"""Appearance features of targets: wavelet preprocessing of windows, eigenspaces, and recognition.

In the order of a frame: `windows` cuts the targets out, `preprocessing` prepares them, `learner` learns a
`feature_space`, which projects them, and `gallery` gives them names. `appearance` joins these steps, `recipe`
holds their settings, and `model_file` saves them. All modules but `element` and `featuresink` work on plain
arrays and serve as a library by themselves. The package `experiments` repeats the published experiments; no
pipeline imports it.
"""
