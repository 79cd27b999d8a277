"""Frames of RTSP over TCP without FFmpeg's delay of one frame; `rtspsrc low-latency=false` switches it off.

FFmpeg's parser ends a frame when the next one begins. RTP marks the last packet of a frame, but FFmpeg does
not pass the mark on. These modules read it in the socket's buffer before FFmpeg takes the packet (Linux);
`live.accessunits` joins the pieces that FFmpeg returns without its parser.
"""
