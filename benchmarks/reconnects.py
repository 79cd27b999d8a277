"""Memory, descriptors and threads over 1000 connections to servers that refuse, close, or play ten frames.

Run it:  python benchmarks/reconnects.py [COUNT]
"""

from __future__ import annotations

import gc
import sys
import threading
import time
from contextlib import suppress

from rtsp_peer import descriptors, resident_mb, server_module

from streamkit import ElementFailure, Message, MessageKind, Pipeline

COUNT = 1000
SETTLE = 100


def figures() -> tuple[float, int, int]:
    """Memory in MB, descriptors, threads."""
    gc.collect()
    return resident_mb(), descriptors(), threading.active_count()


def fail_often(url: str, count: int) -> str:
    """Connects `count` times; what grew between the first hundred and the last."""
    text = (
        f"rtspsrc location={url} reconnect=always max-retries={count} retry-delay-s=0 max-retry-delay-s=0 "
        "timeout-s=2 ! fakesink"
    )
    taken: dict[int, tuple[float, int, int]] = {}
    pipeline = Pipeline.parse(text)

    def note(message: Message) -> None:
        attempt = message.fields.get("attempt")
        if message.fields.get("state") == "retrying" and attempt in (SETTLE, count):
            taken[int(str(attempt))] = figures()

    pipeline.bus.watch(note)
    began = time.monotonic()
    with suppress(ElementFailure):  # it gives up at the end
        pipeline.run(timeout_s=600)
    while pipeline.bus.pop(0, (MessageKind.WARNING,)) is not None:
        continue
    (memory, files, threads), (memory_end, files_end, threads_end) = taken[SETTLE], taken[count]
    return (
        f"{count} connections in {time.monotonic() - began:.1f} s; from the {SETTLE}th on: memory "
        f"{memory_end - memory:+.1f} MB of {memory_end:.0f}, descriptors {files_end - files:+d}, "
        f"threads {threads_end - threads:+d}"
    )


def main() -> None:
    """Runs both servers."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else COUNT
    module = server_module()
    units = module.access_units(count=2)
    server = module.FakeServer(units)
    server.open()
    server.close()
    print("refusing:", fail_often(server.url, count))
    with module.FakeServer(units, module.Behaviour.CLOSE) as closing:
        print("closing: ", fail_often(closing.url, count))
    with module.FakeServer(units, module.Behaviour.CLOSE_AFTER, rate=2000) as playing:
        text = (
            f"rtspsrc location={playing.url} retry-delay-s=0 max-retry-delay-s=0 timeout-s=2 "
            "! decode ! appsink name=out drop=true"
        )
        with Pipeline.parse(text) as pipeline:
            pipeline.play()
            before: tuple[float, int, int] | None = None
            while True:
                frame = pipeline["out"].pull(20)
                if frame.epoch >= SETTLE and before is None:
                    before = figures()
                if frame.epoch >= count:
                    break
            after = figures()
    assert before is not None
    grown = [b - a for a, b in zip(before, after, strict=True)]
    print(
        f"playing ten frames: {count} epochs; memory {grown[0]:+.1f} MB of {after[0]:.0f}, "
        f"descriptors {grown[1]:+.0f}, threads {grown[2]:+.0f}"
    )


if __name__ == "__main__":
    main()
