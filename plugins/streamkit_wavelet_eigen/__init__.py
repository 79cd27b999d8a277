"""Appearance features: wavelet preprocessing of target windows, their eigenspace, and recognition.

The modules beside `element`, `featuresink` and `targets` work on plain arrays and serve as a library by
themselves: `wavelet`, `preprocessing`, `eigenspace`, `fisher`, `recipe`, `feature_space`, `learner`,
`gallery`, `model_file`, `windows`, `pictures`. The room `experiments` holds the published protocol.
"""
