"""Mutation fuzz of media: every variant ends in frames, in a file, or in one documented error.

Variants of real files and of small clips made here go through `filesrc ! decode ! fakesink`, or are remuxed
by packetsink. A violation is an exception that is not documented, one that no thread catches, a hang, a
crash, a descriptor that stays open, and memory that keeps growing.

Run it:  STREAMKIT_DATA=... python benchmarks/fuzz_media.py [--minutes 10]
"""

from __future__ import annotations

import os
import random
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import fuzz_watch

MAX_SOURCE = 1 << 21
SETTLED = 400  # about three variants of each source
EXTREMES = (b"\xff\xff\xff\xff", b"\0\0\0\0", b"\x7f\xff\xff\xff", b"\x80\0\0\0")
SUFFIXES = frozenset(
    {".ts", ".mp4", ".mkv", ".avi", ".264", ".h264", ".webm", ".flv", ".3gp", ".ogv", ".mpeg"}
)
JOBS = ("decode", ".mkv", ".ts", ".mp4")
ENCODERS = {
    "h264": ("libx264", {"g": "12", "bf": "2"}),
    "hevc": ("libx265", {"x265-params": "log-level=error:keyint=12"}),
    "mpeg4": ("mpeg4", {"g": "12"}),
    "mjpeg": ("mjpeg", {}),
}


def make_clips(folder: Path) -> None:
    """Writes 24 frames of each codec into each container that takes it."""
    import av
    import numpy as np

    rows, columns = np.mgrid[:96, :128]
    for name, (encoder, options) in ENCODERS.items():
        for suffix in ("ts", "mp4", "mkv"):
            if name == "mjpeg" and suffix == "ts":
                continue
            with av.open(str(folder / f"{name}.{suffix}"), "w") as container:
                stream = container.add_stream(encoder, rate=25, options=options)
                stream.width, stream.height = 128, 96
                stream.pix_fmt = "yuvj420p" if name == "mjpeg" else "yuv420p"
                for index in range(24):
                    pixels = np.full((144, 128), 128, np.uint8)
                    pixels[:96] = 40 + (rows * columns // 8 + 5 * index) % 160
                    frame = av.VideoFrame.from_ndarray(pixels, "yuv420p").reformat(format=stream.pix_fmt)
                    frame.pts, frame.time_base = index, Fraction(1, 25)
                    container.mux(stream.encode(frame))
                container.mux(stream.encode(None))


def sources(clips: Path) -> list[Path]:
    """The clips made and the small media of the data, in a fixed order."""
    data = Path(os.environ["STREAMKIT_DATA"]) / "data"
    return [
        path
        for folder in (clips, data / "telemetry" / "klv_ts", data / "odd_media")
        for path in sorted(folder.rglob("*"))
        if path.suffix in SUFFIXES and path.stat().st_size <= MAX_SOURCE
    ]


def mutated(data: bytes, chance: random.Random) -> bytes:
    """A variant: bytes changed, runs copied, removed or zeroed, the end cut off; half of them at the head."""
    found = bytearray(data)
    reach = 4096 if chance.random() < 0.5 else len(found)
    for _ in range(chance.choice((1, 1, 2, 4, 16, 64))):
        at = chance.randrange(min(reach, len(found)))
        run = chance.randrange(1, 64)
        kind = chance.randrange(7)
        if kind <= 1:
            found[at] = chance.randrange(256)
        elif kind == 2:
            found[at : at + 4] = chance.choice(EXTREMES)
        elif kind == 3:
            found[at:at] = found[at : at + run]
        elif kind == 4 and len(found) > 2 * run:
            del found[at : at + run]
        elif kind == 5:
            found[at : at + run] = bytes(run)
        elif kind == 6 and len(found) > 200 and chance.random() < 0.1:
            del found[at:]
        if not found:
            found = bytearray(data[:1])
    return bytes(found)


def run_variant(data: bytes, suffix: str, job: str) -> str:
    """How one variant ended: in frames, a file, nothing, or a documented error."""
    from streamkit import ElementFailure, Pipeline, StreamkitError

    path, copy = Path(f"variant{suffix}"), Path(f"copy{job}")
    path.write_bytes(data)
    tail = "decode ! fakesink name=out" if job == "decode" else f"packetsink location={copy}"
    try:
        pipeline = Pipeline.parse(f"filesrc location={path} ! {tail}")
        pipeline.run(timeout_s=fuzz_watch.HANG_S)
        if job != "decode":
            return "file" if copy.is_file() and copy.stat().st_size else "nothing"
        return "frames" if pipeline["out"].count else "nothing"
    except ElementFailure as error:
        # What an element raises by its contract is one of the engine's own errors; all else is a fault of it.
        if not isinstance(error.cause, StreamkitError):
            raise
        return "recording ended" if job != "decode" and "packetsink" in str(error) else "error"
    finally:
        copy.unlink(missing_ok=True)


def make_case() -> fuzz_watch.Case:
    """The function that gives each case."""
    clips = Path("clips")
    clips.mkdir(exist_ok=True)
    make_clips(clips)
    chosen = sources(clips)
    run_variant(chosen[0].read_bytes(), chosen[0].suffix, "decode")  # imports, caches

    def case(number: int) -> tuple[str, Callable[[], str]]:
        source = chosen[number % len(chosen)]
        job = JOBS[number // len(chosen) % len(JOBS)]
        data = mutated(source.read_bytes(), random.Random(number)) or b"\0"

        def play() -> str:
            outcome = run_variant(data, source.suffix, job)
            return f"{'decode' if job == 'decode' else 'remux'} {outcome}"

        return f"{source.name} to {job}", play

    return case


if __name__ == "__main__":
    fuzz_watch.main(__file__, make_case, SETTLED)
