"""Sinks: detections as JSON lines, COCO or MOT, and masks as the CDnet tools read them."""
