"""A web server of a folder, for players of what is in it."""

import functools
import http.server
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

BOUNDARY = b"--frame"


class Handler(http.server.SimpleHTTPRequestHandler):
    """Serves a folder in silence; `/jpeg` is an endless series of pictures."""

    picture = b""

    def do_GET(self) -> None:
        """Answers a request."""
        if self.path != "/jpeg":
            super().do_GET()
            return
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        try:
            while True:
                head = b"\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(self.picture)
                self.wfile.write(BOUNDARY + head + self.picture + b"\r\n")
                time.sleep(0.04)
        except OSError:
            pass  # the client has left

    def log_message(self, *_: object) -> None:
        """Says nothing."""


@contextmanager
def serving(folder: Path) -> Iterator[str]:
    """Context in which a server has a folder; its address."""
    handler = functools.partial(Handler, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,))
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()
        thread.join(10)
