"""What is transmitted: records in four encodings, frames with metadata, message numbers, schemas.

`encodings`, `protobuf`, `images` and `numbering` need no streamkit.
"""
