"""Readers of telemetry: MISB KLV, DJI subtitles, and the Exif and XMP data of photographs.

A library without the engine: the file sources, the telemetry elements and `streamkit doctor` use it.
"""
