"""Core elements: they route, queue and time frames, whatever the frames contain."""
