"""How things are published: bounded lines, one outlet a stream, answers for those who come late.

`records_feed` and `picture_feed` take frames; the others import nothing of streamkit.
"""
