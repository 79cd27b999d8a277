"""Appearance features: wavelet preprocessing of target windows and their eigenspace.

The modules beside `element` work on plain arrays and serve as a library by themselves: `wavelet`,
`preprocessing`, `eigenspace`, `feature_space`, `learner`, `windows`.
"""
