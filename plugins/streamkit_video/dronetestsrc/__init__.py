"""A drone's video with exact truth: a camera flies over an aerial photograph, cars drive below it."""
