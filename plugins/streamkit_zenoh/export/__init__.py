"""Records for other programs: files of several kinds, Cursor-on-Target events; without streamkit.

Records are taken as plain dictionaries, as the JSON form of `streamkit.tracks/1` has them.
"""
