"""trackoverlay: draws boxes, ids, trails and a status line over the video."""
