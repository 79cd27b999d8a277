"""Reports: what the tracker publishes of each target.

Contract: `report(table, ...)` reads the table and changes nothing.
"""
