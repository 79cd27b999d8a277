"""Video in and out through FFmpeg (PyAV): files, pictures, live RTSP, decoding, recording."""
