"""What travels: records in four encodings, frames with their metadata, numbers that show gaps, schemas.

All but `frame_header` import nothing of streamkit.
"""
