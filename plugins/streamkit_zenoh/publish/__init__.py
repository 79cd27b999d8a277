"""Publishing: numbered messages per stream, a bounded queue before each, replies to queries for the last one.

`record_sender`, `frame_sender` and `video_sender` take frames; the other modules need no streamkit.
"""
