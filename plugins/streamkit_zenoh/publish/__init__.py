"""Publishing: numbered messages per stream, a bounded queue before each, replies to queries for the last one.

`record_publisher`, `frame_publisher` and `video_publisher` take frames; the other modules need no streamkit.
"""
