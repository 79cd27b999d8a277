"""What is transmitted: records in four encodings, frames with metadata, message numbers, schemas.

`encodings`, `protobuf`, `images`, `sequence`, `numbering` and `status` need no streamkit.
"""
