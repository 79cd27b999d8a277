"""GStreamer's elements and properties whose work others do here, for the hint of an unknown name."""

from __future__ import annotations

ELEMENTS = {
    "decode, which finds the codec itself":
        "decodebin decodebin3 avdec_h264 avdec_h265 avdec_mjpeg jpegdec pngdec openh264dec vaapih264dec "
        "nvh264dec vah264dec v4l2h264dec dav1ddec vp8dec vp9dec theoradec",
    "encode":
        "x264enc x265enc openh264enc avenc_mpeg4 vaapih264enc nvh264enc vah264enc v4l2h264enc vp8enc "
        "vp9enc",
    "filesrc location=FILE ! decode, rtspsrc location=rtsp://... ! decode":
        "uridecodebin uridecodebin3 urisourcebin parsebin playbin playbin3",
    "nothing; link the source to decode or packetsink":
        "h264parse h265parse jpegparse mpegvideoparse rtph264depay rtph265depay rtpjpegdepay "
        "rtpjitterbuffer qtdemux matroskademux tsdemux avidemux",
    "packetsink for coded packets, videofilesink for raw video":
        "mp4mux qtmux matroskamux mpegtsmux avimux splitmuxsink",
    "no window; zenohsink with `streamkit view`, or videofilesink":
        "autovideosink ximagesink xvimagesink glimagesink waylandsink fpsdisplaysink",
    "livesrc uri=udp://@:PORT": "udpsrc",
    "livesrc uri=URL": "rtmpsrc rtmp2src souphttpsrc hlsdemux hlsdemux2 tcpclientsrc",
    "livesrc uri=udp://127.0.0.1:PORT, with srt-live-transmit srt://HOST:PORT udp://127.0.0.1:PORT running":
        "srtsrc srtclientsrc",
    "livesrc uri=udp://127.0.0.1:PORT, with gst-launch-1.0 v4l2src ! videoconvert ! x264enc tune=zerolatency "
    "key-int-max=30 ! mpegtsmux ! udpsink port=PORT running":
        "v4l2src",
    "packetsink or videofilesink location=udp://HOST:PORT": "udpsink",
    "packetsink or videofilesink location=udp://127.0.0.1:PORT, with srt-live-transmit udp://:PORT "
    "srt://HOST:PORT running":
        "srtsink srtserversink srtclientsink",
    "packetsink or videofilesink location=live.m3u8": "hlssink hlssink2 hlssink3",
    "rtspclientsink, or zenohsink": "tcpserversink rtmpsink rtmp2sink webrtcbin",
    "videoconvert, which negotiation inserts itself": "autovideoconvert videoconvertscale glcolorconvert",
    "trackoverlay, which draws tracks; textoverlay, which draws text": "cairooverlay rsvgoverlay",
    "multifilesrc location=frames/%05d.png": "imagefreeze imagesequencesrc",
    "jpegsink": "jpegenc pngenc",
    "queue": "queue2 multiqueue",
    "filesink location=-": "fdsink",
    "filesrc location=FILE; a pipe cannot be read": "fdsrc",
    "zenohsrc": "shmsrc unixfdsrc",
    "zenohsink": "shmsink unixfdsink",
}  # fmt: skip
BY_NAME = {name: words for words, names in ELEMENTS.items() for name in names.split()}


def gstreamer_hint(name: str) -> str:
    """What does the work of one of GStreamer's elements here, as a hint; "" if nothing does."""
    words = BY_NAME.get(name.lower(), "")
    return f"here: {words}" if words else ""


# By the element here, then by GStreamer's property.
PROPERTIES = {
    "encode": {
        "speed-preset": "preset=WORD",
        "tune": "live=true for zerolatency; leave out the others",
        "key-int-max": "gop=FRAMES",
        "quantizer": "quality=NUMBER",
        "qp-max": "quality=NUMBER",
        "threads": "nothing; the encoder takes what suits the machine",
        "byte-stream": "nothing; the element behind decides",
    },
    "videofilesink": {"speed-preset": "preset=WORD", "quantizer": "crf=NUMBER", "bitrate": "crf=NUMBER"},
    "rtspsrc": {
        "protocols": "transport=tcp or transport=udp",
        "timeout": "timeout-s=SECONDS",
        "tcp-timeout": "timeout-s=SECONDS",
        "retry": "max-retries=NUMBER",
        "drop-on-latency": "nothing; live frames that are too old are dropped",
        "is-live": "nothing; it is always live",
    },
    "decode": {"max-threads": "threads=NUMBER"},
    "filesrc": {
        "num-buffers": "stop-s=SECONDS, or identity eos-after=NUMBER behind it",
        "blocksize": "nothing; it sends whole packets",
    },
    "multifilesrc": {
        "num-buffers": "stop-index=NUMBER",
        "caps": "framerate=NUMBER",
        "index": "start-index=NUMBER",
    },
}
ANYWHERE = {
    "num-buffers": "identity eos-after=NUMBER, which ends the stream",
    "sync": "sync= of a sink, or identity sync=true, which waits for the time of each frame",
    "async": "async= of a sink",
    "is-live": "nothing; the element decides",
    "do-timestamp": "nothing; frames have times",
    "caps": "a filter behind the element: ! video/x-raw, width=... !",
    "max-buffers": "queue max-size-buffers=NUMBER before it",
    "drop": "queue leaky=downstream before it",
}


def property_hint(element: str, name: str) -> str:
    """What does the work of a property of GStreamer's in an element without it, as a hint; "" if unknown."""
    spelling = name.lower().replace("_", "-")
    words = PROPERTIES.get(element, {}).get(spelling) or ANYWHERE.get(spelling, "")
    return f"here: {words}" if words else ""
