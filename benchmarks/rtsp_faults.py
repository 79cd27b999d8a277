"""How soon faults of an RTSP server, or of the network before it, are noticed; the limit is timeout-s + 1 s.

Run it:  python benchmarks/rtsp_faults.py [TIMEOUT_S [ROUNDS]]
"""

from __future__ import annotations

import statistics
import sys
import time
from contextlib import suppress

from rtsp_peer import server_module

from streamkit import ElementFailure, Pipeline

TIMEOUT_S = 1.0
ROUNDS = 5
FAULTS = (
    ("SILENT", "tcp"),
    ("DESCRIBE_ONLY", "tcp"),
    ("NO_MEDIA", "tcp"),
    ("NO_MEDIA", "udp"),
    ("HALF_FRAME", "tcp"),
    ("HALF_FRAME", "udp"),
    ("GARBAGE", "tcp"),
    ("REDIRECT", "tcp"),
    ("CLOSE", "tcp"),
)


def noticed_after_s(url: str, transport: str, timeout_s: float) -> tuple[float, str]:
    """Seconds from the start, or from the last packet, to the error; and the error."""
    source = f"rtspsrc location={url} timeout-s={timeout_s:g} reconnect=never transport={transport}"
    last = time.monotonic()
    with Pipeline.parse(f"{source} ! appsink name=out max-buffers=0") as pipeline:
        pipeline.play()
        with suppress(ElementFailure):
            for _ in pipeline["out"]:
                last = time.monotonic()
        elapsed_s = time.monotonic() - last
        error = pipeline.wait(5)
    return elapsed_s, error.text.partition("/live: ")[2] if error is not None else "no error"


def main() -> None:
    """Runs all faults and prints medians and the longest."""
    timeout_s = float(sys.argv[1]) if len(sys.argv) > 1 else TIMEOUT_S
    rounds = int(sys.argv[2]) if len(sys.argv) > 2 else ROUNDS
    module = server_module()
    units = module.access_units()
    print(f"{'fault':28} {'median':>8} {'longest':>8}  (limit {timeout_s + 1:g} s)")
    for name, transport in FAULTS:
        behaviour = module.Behaviour[name]
        with module.FakeServer(units, behaviour) as server:
            runs = [noticed_after_s(server.url, transport, timeout_s) for _ in range(rounds)]
        times = [elapsed_s for elapsed_s, _ in runs]
        what = f"{name.lower().replace('_', ' ')}, {transport}"
        print(f"{what:28} {statistics.median(times):7.2f}s {max(times):7.2f}s  {runs[0][1][:90]}")


if __name__ == "__main__":
    main()
