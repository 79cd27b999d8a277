"""Track records for other programs: files (JSON lines, MOT, CSV, GeoJSON, KML, MCAP) and Cursor-on-Target.

The commands for files of finished runs share `recorded_runs`: they list and convert targets (`command`), draw
them (`report`), explain one (`explanation`), and score all against ground truth (`evaluation`).
"""
