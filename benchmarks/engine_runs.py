"""Runs pipelines for `engine.py`, in one process for each engine, and measures their time.

    python engine_runs.py streamkit            /usr/bin/python3 engine_runs.py gstreamer

Reads one JSON object a line, {"text": description, "frames": N}, where the text has `num-buffers=FRAMES`;
answers {"wall_s", "cpu_s", "rest_s"}: of the run from the start of streaming to EOS, and of building and
stopping it. `pynoop` in a description is an element written in Python that passes every frame on.
"""

from __future__ import annotations

import json
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

LIMIT_S = 60
Times = tuple[float, float, float]
Run = Callable[[str], Times]


def cpu_s() -> float:
    """Processor time of this process, all threads, s."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def streamkit_run() -> Run:
    """The run of a description by streamkit; `pynoop` is found like any plugin's element."""
    folder = Path(tempfile.mkdtemp())
    (folder / "pynoop-1.dist-info").mkdir()
    (folder / "pynoop-1.dist-info" / "METADATA").write_text("Name: pynoop\nVersion: 1\n", encoding="utf-8")
    (folder / "pynoop-1.dist-info" / "entry_points.txt").write_text(
        "[streamkit.elements]\npynoop = pynoop:Noop\n", encoding="utf-8"
    )
    (folder / "pynoop.py").write_text(
        "from streamkit import Transform\n"
        "class Noop(Transform):\n"
        "    sink = src = 'ANY'\n"
        "    def transform(self, frame):\n"
        "        return frame\n",
        encoding="utf-8",
    )
    sys.path.insert(0, str(folder))
    from streamkit import Pipeline

    def run(text: str) -> Times:
        called = time.perf_counter()
        with Pipeline.parse(text) as pipeline:
            began, cpu_began = time.perf_counter(), cpu_s()
            pipeline.play()
            message = pipeline.wait(LIMIT_S)
            wall, cpu = time.perf_counter() - began, cpu_s() - cpu_began
        if message is None or message.error is not None:
            raise RuntimeError(f"no end of the stream: {message}")
        return wall, cpu, time.perf_counter() - called - wall

    return run


def gstreamer_run() -> Run:
    """The same by GStreamer, through its Python bindings."""
    import gi

    gi.require_version("Gst", "1.0")
    gi.require_version("GstBase", "1.0")
    from gi.repository import Gst, GstBase

    Gst.init(None)
    anything = Gst.Caps.new_any()

    class Noop(GstBase.BaseTransform):  # type: ignore[misc]
        __gstmetadata__ = ("Noop", "Transform", "Passes on", "benchmark")
        __gsttemplates__ = tuple(
            Gst.PadTemplate.new(name, direction, Gst.PadPresence.ALWAYS, anything)
            for name, direction in (("sink", Gst.PadDirection.SINK), ("src", Gst.PadDirection.SRC))
        )

        def do_transform_ip(self, _buffer: Any) -> Any:
            return Gst.FlowReturn.OK

    Gst.Element.register(None, "pynoop", 0, Noop)
    if Gst.ElementFactory.find("pynoop") is None:
        raise RuntimeError("elements in Python need GStreamer's own overrides: python3-gst-1.0")

    def run(text: str) -> Times:
        called = time.perf_counter()
        pipeline = Gst.parse_launch(text)
        began, cpu_began = time.perf_counter(), cpu_s()
        pipeline.set_state(Gst.State.PLAYING)
        kinds = Gst.MessageType.EOS | Gst.MessageType.ERROR
        message = pipeline.get_bus().timed_pop_filtered(LIMIT_S * Gst.SECOND, kinds)
        wall, cpu = time.perf_counter() - began, cpu_s() - cpu_began
        pipeline.set_state(Gst.State.NULL)
        if message is None or message.type != Gst.MessageType.EOS:
            raise RuntimeError("no end of the stream")
        return wall, cpu, time.perf_counter() - called - wall

    return run


def main() -> None:
    """Answers requests until stdin ends."""
    run = {"streamkit": streamkit_run, "gstreamer": gstreamer_run}[sys.argv[1]]()
    print(json.dumps({"ready": True}), flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        wall, cpu, rest = run(request["text"].replace("FRAMES", str(request["frames"])))
        print(json.dumps({"wall_s": wall, "cpu_s": cpu, "rest_s": rest}), flush=True)


if __name__ == "__main__":
    main()
