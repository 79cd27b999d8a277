"""Scores tracks against ground truth: `scores` on arrays, `readers` of files, `command` for users."""
