"""GStreamer's elements and properties whose work others do here, for the hint of an unknown name."""

from __future__ import annotations

ELEMENTS = {
    "decode, which finds the codec itself":
        "decodebin decodebin3 avdec_h264 avdec_h265 avdec_hevc avdec_mjpeg avdec_mpeg2video avdec_mpeg4 "
        "avdec_vp8 avdec_vp9 jpegdec pngdec openh264dec libde265dec dav1ddec av1dec vp8dec vp9dec theoradec "
        "mpeg2dec vaapih264dec vaapih265dec vah264dec vah265dec nvh264dec nvh265dec nvv4l2decoder "
        "v4l2h264dec v4l2h265dec omxh264dec qsvh264dec msdkh264dec",
    "encode":
        "x264enc x265enc openh264enc avenc_mpeg4 avenc_mjpeg avenc_h264 vp8enc vp9enc av1enc svtav1enc "
        "rav1enc vaapih264enc vaapih265enc vah264enc vah265enc nvh264enc nvh265enc nvv4l2h264enc "
        "nvv4l2h265enc v4l2h264enc omxh264enc qsvh264enc msdkh264enc",
    "filesrc location=FILE ! decode, rtspsrc location=rtsp://... ! decode":
        "uridecodebin uridecodebin3 urisourcebin parsebin playbin playbin3",
    "nothing; link the source to decode or packetsink":
        "h264parse h265parse av1parse vp9parse jpegparse pngparse mpegvideoparse mpeg4videoparse tsparse "
        "typefind rtph264depay rtph265depay rtpjpegdepay rtpmp2tdepay rtpvp8depay rtpvp9depay rtpav1depay "
        "rtpjitterbuffer rtpbin qtdemux matroskademux tsdemux avidemux flvdemux",
    "nothing; encode ! rtspclientsink sends RTP to a server, packetsink location=udp://HOST:PORT MPEG-TS":
        "rtph264pay rtph265pay rtpjpegpay rtpvp8pay rtpvp9pay rtpav1pay rtpmp2tpay",
    "packetsink for coded packets, videofilesink for raw video":
        "mp4mux qtmux matroskamux webmmux mpegtsmux avimux flvmux splitmuxsink",
    "replaysrc for a recording of packetsink, filesrc for one file": "splitmuxsrc splitfilesrc",
    "no window; zenohsink with `streamkit view`, or videofilesink":
        "autovideosink ximagesink xvimagesink glimagesink waylandsink fpsdisplaysink kmssink gtksink "
        "d3dvideosink aasink cacasink nveglglessink nv3dsink",
    "livesrc uri=udp://@:PORT": "udpsrc",
    "livesrc uri=URL": "rtmpsrc rtmp2src souphttpsrc curlhttpsrc hlsdemux hlsdemux2",
    "livesrc uri=tcp://HOST:PORT": "tcpclientsrc",
    "livesrc uri=tcp://0.0.0.0:PORT?listen=1": "tcpserversrc",
    "livesrc uri=udp://127.0.0.1:PORT, with srt-live-transmit srt://HOST:PORT udp://127.0.0.1:PORT running":
        "srtsrc srtclientsrc",
    "livesrc uri=udp://127.0.0.1:PORT, with gst-launch-1.0 SOURCE ! videoconvert ! x264enc tune=zerolatency "
    "key-int-max=30 ! mpegtsmux ! udpsink port=PORT running":
        "v4l2src autovideosrc libcamerasrc nvarguscamerasrc ximagesrc pipewiresrc avfvideosrc ksvideosrc",
    "packetsink or videofilesink location=udp://HOST:PORT": "udpsink multiudpsink",
    "packetsink or videofilesink location=udp://127.0.0.1:PORT, with srt-live-transmit udp://:PORT "
    "srt://HOST:PORT running":
        "srtsink srtserversink srtclientsink",
    "packetsink or videofilesink location=live.m3u8": "hlssink hlssink2 hlssink3 dashsink",
    "rtspclientsink, or zenohsink":
        "tcpserversink tcpclientsink rtmpsink rtmp2sink webrtcbin webrtcsink whipsink",
    "videoconvert, which negotiation inserts itself":
        "autovideoconvert videoconvertscale glcolorconvert nvvidconv nvvideoconvert vaapipostproc vapostproc "
        "v4l2convert",
    "no such filter; `streamkit new NAME` makes an element of yours, for a line or two of OpenCV":
        "videobalance gamma coloreffects smooth videomedian edgedetect cvsmooth cvsobel cvlaplace cvdilate "
        "cverode facedetect templatematch",
    "nothing; ffmpeg -i IN -vf bwdif OUT deinterlaces a file before":
        "deinterlace avdeinterlace vaapideinterlace vadeinterlace",
    "videocrop": "videobox aspectratiocrop",
    "compositor, which puts videos side by side": "videomixer glvideomixer nvmultistreamtiler nvstreammux",
    "rectify": "cameraundistort dewarp",
    "framediff": "motioncells",
    "particletrack": "nvtracker cvtracker gvatrack",
    "detectionsrc, which reads the detections of any detector from a file":
        "nvinfer nvinferserver gvadetect hailonet tensor_filter",
    "trackoverlay, which draws tracks; textoverlay, which draws text":
        "cairooverlay rsvgoverlay gdkpixbufoverlay nvdsosd gvawatermark subtitleoverlay textrender",
    "telemetryparse, or posesync, which attaches poses to frames": "klvparse klvinspect subparse",
    "multifilesrc location=frames/%05d.png": "imagefreeze imagesequencesrc",
    "jpegsink, which writes a file for each frame": "jpegenc pngenc webpenc",
    "queue": "queue2 multiqueue",
    "fakesink": "fakevideosink",
    "no sound":
        "autoaudiosink autoaudiosrc audiotestsrc audioconvert audioresample alsasrc alsasink pulsesrc",
    "nothing; `streamkit launch --stats` shows rate and load of elements": "progressreport perf cpureport",
    "nothing; `streamkit launch --watchdog-s SECONDS` fails a pipeline in which an element hangs": "watchdog",
    "filesink location=-": "fdsink",
    "filesrc location=FILE; a pipe cannot be read": "fdsrc",
    "zenohsrc": "shmsrc unixfdsrc intervideosrc interpipesrc proxysrc",
    "zenohsink": "shmsink unixfdsink intervideosink interpipesink proxysink",
}  # fmt: skip
BY_NAME = {name: words for words, names in ELEMENTS.items() for name in names.split()}


def gstreamer_hint(name: str) -> str:
    """What does the work of one of GStreamer's elements here, as a hint; "" if nothing does."""
    words = BY_NAME.get(name.lower(), "").replace("SOURCE", name.lower())
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
        "uri": "location=URL",
        "url": "location=URL",
        "protocols": "transport=tcp or transport=udp",
        "timeout": "timeout-s=SECONDS",
        "tcp-timeout": "timeout-s=SECONDS",
        "retry": "max-retries=NUMBER",
        "drop-on-latency": "nothing; live frames that are too old are dropped",
        "is-live": "nothing; it is always live",
    },
    "compositor": dict.fromkeys(
        ("xpos", "ypos", "width", "height", "zorder", "alpha"),
        "nothing; inputs are side by side in the order of their links, videoscale and videocrop size them",
    )
    | {"background": "nothing; what no input covers is black"},
    **dict.fromkeys(
        ("videotestsrc", "dronetestsrc"),
        dict.fromkeys(
            ("width", "height", "framerate", "format"),
            "a caps filter behind it: video/x-raw with width, height, framerate, format",
        ),
    ),
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
    spelling = name.lower().rpartition("::")[2].replace("_", "-")  # of a pad's property, the property
    words = PROPERTIES.get(element, {}).get(spelling) or ANYWHERE.get(spelling, "")
    return f"here: {words}" if words else ""
