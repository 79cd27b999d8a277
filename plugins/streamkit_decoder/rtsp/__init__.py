"""Live video over RTSP that never hangs: FFmpeg reads, a watchdog outside it decides."""
