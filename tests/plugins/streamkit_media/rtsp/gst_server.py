"""An RTSP server for the tests; run by the system's Python, prints its port.

gst_server.py            plays rtsp://user:secret@127.0.0.1:PORT/live, of H.264, /vp9, /jpeg and /large-jpeg
gst_server.py FOLDER     records rtsp://user:secret@127.0.0.1:PORT/CODEC to FOLDER/CODEC; h264 and h265
"""

import sys

import gi

gi.require_version("Gst", "1.0")
gi.require_version("GstRtspServer", "1.0")
from gi.repository import GLib, Gst, GstRtspServer  # noqa: E402  the versions must be chosen first

LIVE = (
    "( videotestsrc is-live=true pattern=ball ! video/x-raw,width=320,height=240,framerate=30/1 "
    "! x264enc tune=zerolatency speed-preset=ultrafast key-int-max=15 "
    "! rtph264pay name=pay0 pt=96 config-interval=1 )"
)
VP9 = (
    "( videotestsrc is-live=true ! video/x-raw,width=320,height=240,framerate=30/1 "
    "! vp9enc deadline=1 cpu-used=8 keyframe-max-dist=15 ! rtpvp9pay name=pay0 pt=96 )"
)
JPEG = (
    "( videotestsrc is-live=true pattern=ball "
    "! video/x-raw,format=I420,width={width},height=240,framerate=15/1 "
    "! jpegenc ! rtpjpegpay name=pay0 pt=26 )"
)
RECORDING = (
    "( rtp{codec}depay name=depay0 ! video/x-{codec},stream-format=byte-stream,alignment=au "
    "! filesink location={folder}/{codec} buffer-mode=unbuffered sync=false async=false )"
)
ROLE = "user"


def add_mount(server: GstRtspServer.RTSPServer, path: str, launch: str) -> GstRtspServer.RTSPMediaFactory:
    """Adds a path that user:secret may use."""
    permissions = GstRtspServer.RTSPPermissions.new()
    permissions.add_permission_for_role(ROLE, "media.factory.access", True)
    permissions.add_permission_for_role(ROLE, "media.factory.construct", True)
    factory = GstRtspServer.RTSPMediaFactory()
    factory.set_launch(launch)
    factory.set_permissions(permissions)
    server.get_mount_points().add_factory(path, factory)
    return factory


def main() -> None:
    """Serves until killed."""
    Gst.init(None)
    server = GstRtspServer.RTSPServer()
    server.set_address("127.0.0.1")
    server.set_service("0")
    token = GstRtspServer.RTSPToken.new()
    token.set_string("media.factory.role", ROLE)
    auth = GstRtspServer.RTSPAuth.new()
    auth.add_basic(GstRtspServer.RTSPAuth.make_basic("user", "secret"), token)
    server.set_auth(auth)
    if folder := sys.argv[1:]:
        for codec in ("h264", "h265"):
            factory = add_mount(server, f"/{codec}", RECORDING.format(codec=codec, folder=folder[0]))
            factory.set_transport_mode(GstRtspServer.RTSPTransportMode.RECORD)
            factory.set_latency(0)
    else:
        add_mount(server, "/live", LIVE).set_shared(True)
        add_mount(server, "/vp9", VP9).set_shared(True)
        add_mount(server, "/jpeg", JPEG.format(width=320)).set_shared(True)
        add_mount(server, "/large-jpeg", JPEG.format(width=2560)).set_shared(True)
    server.attach(None)
    print(server.get_bound_port(), flush=True)
    GLib.MainLoop().run()


main()
