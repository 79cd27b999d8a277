"""The whole pipeline at 1080p: decode, stitch, framediff, waveleteigen, particletrack, zenohsink.

From a file, as fast as it goes; and live over RTSP at 25/s with the ready pipelines, as they are.
Beside it the script that one would write: cv2.VideoCapture, MOG2, and CSRT (MIL where OpenCV has no CSRT).

    python benchmarks/pipeline.py [--video FILE] [--size 1920 1080] [--seconds 60] [--repeats 5]
                                  [--live] [--contrib PYTHON]
    python benchmarks/pipeline.py --placement [--video FILE] [--repeats 5]

With --placement only: the whole chain in one thread, decoder and libraries without threads of their own, and
the same description with `--processes auto`, in turn. Goal on two cores: 1.35 times the frames a second.

With --live only the live runs, for example with --size 3840 2160.

Without --video a synthetic flight is made. The video is played forward and backward in turn, so that a short
one can be flown for a minute without a cut. A subscriber in a process of its own receives the records. The
age of a live record is from the wall clock that the server tells in its sender reports to its receipt; the
first seconds, in which both sides start, are left out. CPU is that of the pipeline's process.

Goal on two cores: 25 frames a second live, none dropped, median age at most 60 ms.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
from rtsp_peer import server_module

from streamkit import Pipeline
from streamkit.handoff.library_threads import ONE_A_CORE, ONE_THREAD

HERE = Path(__file__).resolve().parent
STREAMKIT = str(Path(sys.executable).with_name("streamkit"))
PIPELINES = HERE.parent / "pipelines"
AUTO = ("--processes", "auto")
LIVE_PIPELINES = {
    "live, tracks alone": ("rtsp-to-tracks.pipe", ()),
    "live, with mosaic": ("rtsp-to-zenoh.pipe", ()),
    "live, processes auto": ("rtsp-to-tracks.pipe", AUTO),
}
RATE = 25
FORWARD_FRAMES = 150
SETTLE_S, START_LIMIT_S, RUN_LIMIT_S = 3.0, 120.0, 600.0
KEY = f"bench/{os.getpid()}"
IN_ONE_THREAD = (
    "filesrc location={video} ! decode ! stitch ! framediff ! waveleteigen ! particletrack ! {sink}"
)
WITH_QUEUES = (
    "filesrc location={video} ! decode ! queue max-size-buffers=4 ! stitch ! queue max-size-buffers=4 "
    "! framediff ! waveleteigen ! queue max-size-buffers=4 ! particletrack ! {sink}"
)
IN_TWO_PROCESSES = (
    "filesrc location={video} ! decode ! stitch "
    "! ( process=true framediff ! waveleteigen ! particletrack ! {sink} )"
)
Statistics = dict[str, Any]


def there_and_back(video: Path | None, folder: Path, width: int = 1920, height: int = 1080) -> Path:
    """An H.264 file of a size that goes forward and backward through a video, without B-frames."""
    if video is None:
        video = folder / "flight.mp4"
        size = f"video/x-raw, width={width}, height={height}, framerate={RATE}/1"
        text = f"dronetestsrc num-buffers={FORWARD_FRAMES} seed=1 cars=20 ! {size} ! videofilesink"
        Pipeline.parse(f"{text} location={video}").run(timeout_s=600)
    pictures = []
    with av.open(str(video)) as source:
        for picture in source.decode(video=0):
            pictures.append(picture.reformat(width, height, "yuv420p"))
            if len(pictures) == FORWARD_FRAMES:
                break
    made = folder / "there_and_back.mp4"
    with av.open(str(made), "w") as target:
        options = {"preset": "veryfast", "tune": "zerolatency", "g": str(RATE)}
        stream = target.add_stream("libx264", rate=RATE, options=options)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.bit_rate = 4 * width * height  # 8 Mbit/s for 1080p
        for number, picture in enumerate([*pictures, *pictures[-2:0:-1]]):
            picture.pts, picture.time_base = number, Fraction(1, RATE)
            target.mux(stream.encode(picture))
        target.mux(stream.encode(None))
    return made


def serve(video: str) -> None:
    """A process: plays the access units of a file over RTSP again and again; prints its address."""
    with av.open(video) as source:
        stream = source.streams.video[0]
        to_annexb = av.BitStreamFilterContext("h264_mp4toannexb", stream)
        units = [
            bytes(unit)
            for packet in source.demux(stream)
            if packet.dts is not None
            for unit in to_annexb.filter(packet)
        ]
    with server_module().FakeServer(units, rate=float(RATE)) as server:
        print(server.url, flush=True)
        sys.stdin.read()


def listen(key: str) -> None:
    """A process: prints number, age since capture (ms or null) and confirmed tracks of each record."""
    from streamkit_zenoh import TrackSubscriber

    with TrackSubscriber(key, ring=1000, ends_with_publisher=True) as subscriber:
        for update in subscriber.updates():
            now_ns, record = time.time_ns(), update.record
            if record is not None:
                known = record.capture_ns is not None and record.capture_origin == "rtcp"
                age_ms = (now_ns - record.capture_ns) / 1e6 if known and record.capture_ns else None
                confirmed = sum(track.state == "confirmed" for track in record.tracks)
                print(json.dumps([record.seq, age_ms, confirmed]), flush=True)


@contextmanager
def process(*words: str, python: str = sys.executable) -> Iterator[subprocess.Popen[str]]:
    """One of the processes above; ended with the block."""
    command = [python, *words]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
        try:
            yield child
        finally:
            if child.stdin is not None and not child.stdin.closed:
                child.stdin.close()
            try:
                child.wait(20)
            except subprocess.TimeoutExpired:
                child.kill()


def launch(
    words: list[str], seconds: float | None, variables: Mapping[str, str] = {}
) -> tuple[Statistics, list[list[Any]], float]:
    """Runs `streamkit launch` with a subscriber, to its end or for `seconds` from the first record.

    `variables` are added to its environment.

    Returns:
        Its statistics, the records received, and the CPU time of its process, s.
    """
    with process(__file__, "listen", KEY) as subscriber, tempfile.TemporaryFile("w+") as output:
        command = [STREAMKIT, "launch", "-e", "--stats=json", *words]
        child = subprocess.Popen(command, stdout=output, env={**os.environ, **variables})
        limit = threading.Timer((seconds or RUN_LIMIT_S) + START_LIMIT_S, subscriber.kill)
        limit.start()
        lines, ends_s = [], math.inf
        for line in subscriber.stdout or ():  # until the publisher ends
            lines.append(line)
            if len(lines) == 1 and seconds is not None:
                ends_s = time.monotonic() + seconds
            if time.monotonic() > ends_s:
                child.send_signal(signal.SIGINT)
                ends_s = math.inf
        limit.cancel()
        if not lines:
            child.send_signal(signal.SIGINT)
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        output.seek(0)
        text = output.read()
    if child.returncode:
        raise SystemExit(f"streamkit launch {' '.join(words)} ended with {child.returncode}")
    return json.loads(text), [json.loads(line) for line in lines], usage.ru_utime + usage.ru_stime


def drops(run: Statistics) -> str:
    """Frames dropped, by element and reason."""
    lost = {
        f"{row['element']}: {reason}": count
        for row in run["elements"]
        for reason, count in row["dropped"].items()
    }
    return "; ".join(f"{count} {where}" for where, count in lost.items()) or "none"


def frames_of(run: Statistics) -> int:
    """Frames that reached the tracker."""
    return max(row["frames_in"] for row in run["elements"] if row["factory"] == "particletrack")


def costs(run: Statistics) -> str:
    """Working time per frame of each element."""
    spent = [
        f"{row['factory']} {row['busy_ns'] / row['frames_in'] / 1e6:.1f}"
        for row in run["elements"]
        if row["frames_in"] and row["factory"] not in ("queue", "capsfilter", "tee")
    ]
    return "ms a frame: " + ", ".join(spent)


def from_file(name: str, text: str, video: Path, repeats: int) -> None:
    """As fast as it goes: frames a second over the whole run, start included."""
    rates, loads, run, records = [], [], {}, []
    for _ in range(repeats):
        sink = f"zenohsink key={KEY} wait-subscribers=1"
        run, records, cpu_s = launch([text.format(video=video, sink=sink)], None)
        frames = frames_of(run)
        rates.append(frames / run["elapsed_s"])
        loads.append(cpu_s / frames * 1e3)
    print(
        f"{name:<22} {statistics.median(rates):6.1f} frames/s   "
        f"{statistics.median(loads):6.1f} ms CPU a frame   "
        f"{frames_of(run)} frames, {len(records)} records, dropped: {drops(run)}"
    )
    print(f"{'':<22} {costs(run)}", flush=True)


def compare_placement(video: Path, repeats: int) -> None:
    """One thread in one process, and `--processes auto`: frames a second of the run, without its start."""
    sink = f"zenohsink key={KEY} wait-subscribers=1"
    text = IN_ONE_THREAD.format(video=video, sink=sink)
    single = text.replace("! decode !", "! decode threads=1 !")
    alone = dict.fromkeys((*ONE_THREAD, *ONE_A_CORE), "1")
    pairs = []
    for _ in range(repeats):
        runs = launch([single], None, alone)[0], launch(["--processes", "auto", text], None)[0]
        pairs.append(tuple(frames_of(run) / run["elapsed_s"] for run in runs))
        one, placed = pairs[-1]
        print(
            f"one thread {one:6.1f}   --processes auto {placed:6.1f} frames/s   {placed / one:.2f}",
            flush=True,
        )
        for run in runs:
            print(f"    {costs(run)}", flush=True)
    print(f"median of {repeats}: {statistics.median(placed / one for one, placed in pairs):.2f} times")


def live(name: str, words: Sequence[str], video: Path, seconds: float) -> None:
    """Over RTSP at 25/s, a ready pipeline: words of its command line."""
    with process(__file__, "serve", str(video)) as server:
        assert server.stdout is not None
        url = server.stdout.readline().strip()
        settings = [f"--set=location={url}", f"--set=key={KEY}"]
        run, records, cpu_s = launch([*words, *settings], seconds + SETTLE_S)
    first = records[0][0] + round(SETTLE_S * RATE) if records else 0
    settled = [record for record in records if record[0] >= first]
    ages = sorted(record[1] for record in settled if record[1] is not None)
    if len(ages) < 2:
        print(f"{name:<22} {len(ages)} records with an age came; dropped: {drops(run)}")
        return
    span = settled[-1][0] - settled[0][0] + 1
    high = ages[min(len(ages) - 1, round(0.99 * len(ages)))]
    print(
        f"{name:<22} {len(settled) / span * RATE:6.1f} frames/s   "
        f"{cpu_s / frames_of(run) * 1e3:6.1f} ms CPU a frame   "
        f"age median {statistics.median(ages):.1f} ms, 99 % {high:.1f} ms"
    )
    print(f"{'':<22} frames without a record after the start: {span - len(settled)} of {span}; "
          f"dropped in the whole run: {drops(run)}")  # fmt: skip
    print(f"{'':<22} {costs(run)}")
    confirmed = statistics.mean(record[2] for record in settled)
    print(f"{'':<22} tracks confirmed in a frame: {confirmed:.1f}", flush=True)


def peers(video: Path, python: str, seconds: float) -> None:
    """The plain script, on the file and live."""
    script = str(HERE / "pipeline_peer.py")

    def print_result(name: str, location: str) -> None:
        with process(script, location, str(seconds), python=python) as child:
            line = child.communicate(timeout=seconds + 120)[0].splitlines()[-1]
        found = json.loads(line)
        lag = f"   behind by {found['lag_s']:.1f} s after {found['seconds']:.0f} s" if name == "live" else ""
        print(
            f"{'cv2, MOG2, ' + found['tracker'] + ', ' + name:<22} {found['frames_s']:6.1f} frames/s   "
            f"{found['cpu_ms']:6.1f} ms CPU a frame   {found['targets']:.1f} targets a frame{lag}",
            flush=True,
        )

    print_result("file", str(video))
    with process(__file__, "serve", str(video)) as server:
        assert server.stdout is not None
        print_result("live", server.stdout.readline().strip())


def main() -> None:
    """Prints a table."""
    arguments = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    arguments.add_argument("--video", type=Path, help="a synthetic flight otherwise")
    arguments.add_argument("--size", type=int, nargs=2, default=(1920, 1080), help="width and height, px")
    arguments.add_argument("--seconds", type=float, default=60.0, help="length of the live run")
    arguments.add_argument("--repeats", type=int, default=5, help="runs from the file")
    arguments.add_argument("--contrib", default=sys.executable, help="Python with opencv-contrib, for CSRT")
    arguments.add_argument("--placement", action="store_true", help="one thread and --processes auto only")
    arguments.add_argument("--live", action="store_true", help="the live runs only")
    options = arguments.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        video = there_and_back(options.video, Path(folder), *options.size)
        if options.placement:
            compare_placement(video, options.repeats)
            return
        if not options.live:
            from_file("file, one thread", IN_ONE_THREAD, video, options.repeats)
            from_file("file, with queues", WITH_QUEUES, video, options.repeats)
            from_file("file, two processes", IN_TWO_PROCESSES, video, options.repeats)
        for name, (pipeline, words) in LIVE_PIPELINES.items():
            live(name, [*words, "-f", str(PIPELINES / pipeline)], video, options.seconds)
        if not options.live:
            peers(video, options.contrib, options.seconds)


if __name__ == "__main__":
    if sys.argv[1:2] == ["serve"]:
        serve(sys.argv[2])
    elif sys.argv[1:2] == ["listen"]:
        listen(sys.argv[2])
    else:
        main()
