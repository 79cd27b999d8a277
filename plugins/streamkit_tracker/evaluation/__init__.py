"""Scores tracks against ground truth: one target in one pass, or many with their identities.

`one_pass` and `identities` work on arrays; `readers` knows the layouts; `command` is `streamkit trackeval`.
"""
