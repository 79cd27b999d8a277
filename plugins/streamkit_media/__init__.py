"""Video in and out through FFmpeg (PyAV).

`container` opens what is read, `streams` and `codecs` make frames and caps of its packets and streams, and
`failures` has the errors. Packets come from `files`, from `live` connections with those of `rtsp`, and from
recordings; `decoding` and `encoding` lie between packets and frames; `recording` writes packets to files,
over the network and as playlists; `doctor` examines a stream.
"""
