"""Publishing: numbered messages per stream, a bounded queue before each, replies to queries for the last one.

`record_sender` and `media_sender` take frames.
"""
