"""Where the camera was and how it looked: MISB ST 0601 and DJI subtitles, paired with frames by time."""
