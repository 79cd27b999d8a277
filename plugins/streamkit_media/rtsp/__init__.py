"""Live video over RTSP: FFmpeg reads in a thread, a watchdog outside it bounds every wait."""
