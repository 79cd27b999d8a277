"""Video in and out through FFmpeg (PyAV): files, decoding, encoding, recording, RTSP, `doctor`."""
