"""Track records for other programs: files (JSON lines, MOT, CSV, GeoJSON, KML, MCAP) and Cursor-on-Target.

`file_formats` and `cursor_on_target` take records as dictionaries with the fields of their JSON and need no
streamkit.
"""
