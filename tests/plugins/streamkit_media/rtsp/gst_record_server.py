"""An RTSP server that records what is pushed to it; run by the system's Python, prints its port."""

import sys

import gi

gi.require_version("Gst", "1.0")
gi.require_version("GstRtspServer", "1.0")
from gi.repository import GLib, Gst, GstRtspServer  # noqa: E402  the versions must be chosen first

ROLE = "user"


def main() -> None:
    """Records rtsp://user:secret@127.0.0.1:PORT/CODEC to FOLDER/CODEC until killed; h264 and h265."""
    Gst.init(None)
    server = GstRtspServer.RTSPServer()
    server.set_address("127.0.0.1")
    server.set_service("0")
    token = GstRtspServer.RTSPToken.new()
    token.set_string("media.factory.role", ROLE)
    auth = GstRtspServer.RTSPAuth.new()
    auth.add_basic(GstRtspServer.RTSPAuth.make_basic("user", "secret"), token)
    server.set_auth(auth)
    permissions = GstRtspServer.RTSPPermissions.new()
    permissions.add_permission_for_role(ROLE, "media.factory.access", True)
    permissions.add_permission_for_role(ROLE, "media.factory.construct", True)
    for codec in ("h264", "h265"):
        factory = GstRtspServer.RTSPMediaFactory()
        factory.set_launch(
            f"( rtp{codec}depay name=depay0 ! video/x-{codec},stream-format=byte-stream,alignment=au "
            f"! filesink location={sys.argv[1]}/{codec} buffer-mode=unbuffered sync=false async=false )"
        )
        factory.set_transport_mode(GstRtspServer.RTSPTransportMode.RECORD)
        factory.set_latency(0)
        factory.set_permissions(permissions)
        server.get_mount_points().add_factory(f"/{codec}", factory)
    server.attach(None)
    print(server.get_bound_port(), flush=True)
    GLib.MainLoop().run()


main()
