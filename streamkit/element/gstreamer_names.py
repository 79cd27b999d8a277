"""GStreamer's elements whose work another element does here, for the hint of an unknown name."""

from __future__ import annotations

ELEMENTS = {
    "decode, which finds the codec itself":
        "decodebin decodebin3 avdec_h264 avdec_h265 avdec_mjpeg jpegdec pngdec openh264dec vaapih264dec "
        "nvh264dec vah264dec v4l2h264dec dav1ddec vp8dec vp9dec theoradec",
    "encode":
        "x264enc x265enc openh264enc avenc_mpeg4 vaapih264enc nvh264enc vah264enc v4l2h264enc vp8enc "
        "vp9enc",
    "filesrc location=FILE ! decode": "uridecodebin uridecodebin3 urisourcebin parsebin playbin playbin3",
    "nothing; link the source to decode or packetsink":
        "h264parse h265parse jpegparse mpegvideoparse rtph264depay rtph265depay rtpjpegdepay "
        "rtpjitterbuffer qtdemux matroskademux tsdemux avidemux",
    "packetsink for coded packets, videofilesink for raw video":
        "mp4mux qtmux matroskamux mpegtsmux avimux splitmuxsink",
    "no window; zenohsink with `streamkit view`, or videofilesink":
        "autovideosink ximagesink xvimagesink glimagesink waylandsink fpsdisplaysink",
    "filesrc location=URL for what FFmpeg opens, rtspsrc for RTSP":
        "udpsrc srtsrc rtmpsrc rtmp2src souphttpsrc hlsdemux v4l2src",
    "rtspclientsink, or zenohsink": "udpsink tcpserversink srtsink rtmpsink rtmp2sink webrtcbin",
    "videoconvert, which negotiation inserts itself": "autovideoconvert videoconvertscale glcolorconvert",
    "trackoverlay, which draws tracks": "timeoverlay textoverlay clockoverlay cairooverlay",
    "multifilesrc location=frames/%05d.png": "imagefreeze imagesequencesrc",
    "jpegsink": "jpegenc pngenc",
    "queue": "queue2 multiqueue",
    "filesink location=/dev/stdout": "fdsink",
    "filesrc location=FILE; a pipe cannot be read": "fdsrc",
    "zenohsrc": "shmsrc unixfdsrc",
    "zenohsink": "shmsink unixfdsink",
}  # fmt: skip
BY_NAME = {name: words for words, names in ELEMENTS.items() for name in names.split()}


def gstreamer_hint(name: str) -> str:
    """What does the work of one of GStreamer's elements here, as a hint; "" if nothing does."""
    words = BY_NAME.get(name.lower(), "")
    return f"here: {words}" if words else ""
