"""Files of what was found: detections as JSON lines, COCO or MOT, masks as the CDnet tools read them."""
