"""Publishing: numbered messages per stream, a bounded queue before each, replies to queries for the last one.

`senders` take frames.
"""
