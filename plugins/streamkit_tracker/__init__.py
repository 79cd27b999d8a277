"""particletrack: follows what moves with layered particle filters, many targets at once.

The algorithm modules work on plain arrays and import nothing of streamkit: `MultiTargetTracker` in `tracker`
is the way in; `layered_filter`, `eigen_template` and `window_sampling` serve by themselves.
"""
