"""Tracks drawn over the video: boxes, ids, trails that stay on the ground, a line of status."""
