"""What is left of each output after each way in which a run can end.

Every run writes all outputs at once, from a live source of 20 frames a second that notes each frame it has
given. The file systems for the full disk and the unwritable folder need the right to mount.

Run it:  python benchmarks/endings.py [KILLS]           writes the table in docs/outputs.md
         python benchmarks/endings.py recorder [KILLS]  segments of a recorder that is killed again and again
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from xml.etree import ElementTree

import av
import cv2
import numpy as np
import pyarrow.parquet
from av.error import InvalidDataError
from mcap.exceptions import EndOfFile
from mcap.stream_reader import StreamReader

RATE = 20
KILLS, RECORDER_KILLS = 20, 200
MOMENTS_S = (2.5, 6.0)  # when a run is killed, at random
BINARY = str(Path(sys.executable).with_name("streamkit"))
PAGE = Path(__file__).parents[1] / "docs" / "outputs.md"
BEGIN, END = "<!-- endings -->", "<!-- end -->"
SOURCE = '''
import math, os, time
import cv2
import numpy as np
from streamkit import *
RNG = np.random.default_rng(1)
GROUND = RNG.integers(30, 220, (60, 400)).astype(np.uint8)
GROUND = cv2.resize(GROUND, (2400, 360), interpolation=cv2.INTER_CUBIC)
POSE = Pose(48.0, 11.0, 600.0, heading=0.0, pitch=0.0, roll=0.0, sensor_angles=(0.0, -math.pi / 2, 0.0),
            field_of_view=(1.0, 0.8))

class EndingSrc(Source):
    """Frames with all that sinks write."""
    src = "video/x-raw, format=GRAY8, width=320, height=240"
    is_live = True
    count: int = Property(100_000, doc="Frames.")
    rate: float = Property(20.0, doc="Frames per second.")
    seen: str = Property("", doc="File of the number of frames given.")

    def negotiate(self, allowed):
        return raw_video_caps("GRAY8", 320, 240, framerate="20/1")

    def frames(self):
        caps, file = self.negotiate(None), os.open(self.seen, os.O_CREAT | os.O_WRONLY)
        for n in range(self.count):
            if self.stopping.wait(1 / self.rate if self.rate else 0):
                return
            shift = n * 2 % 2000
            track = Track(7, TrackState.CONFIRMED, 80.0, 60.0, 8.0, 4.0, 0.0, (1.0, 2.0), np.eye(2), 0.5, 7)
            found = Detections(np.array([[9.5, 4.5]]), np.array([[0., 0., 19., 9.]]), np.ones(1), np.ones(1))
            frame = Frame(GROUND[40:280, shift:shift + 320].copy(), caps, pts=n * 50_000_000, seq=n,
                          capture=Capture(time.time_ns(), "arrival"))
            yield (frame.attach(Tracks((track,))).attach(found).attach(POSE)
                   .attach(Features(np.ones((1, 16), np.float32))))
            os.pwrite(file, b"%010d" % (n + 1), 0)
'''

Reader = Callable[[Path], int]


def video_frames(path: Path) -> int:
    """Frames that decode, up to a packet that is cut short."""
    count = 0
    with av.open(str(path)) as container, suppress(InvalidDataError):
        for _ in container.decode(video=0):
            count += 1
    assert count, "no frame"
    return count


def json_lines(path: Path) -> int:
    """Whole lines."""
    return sum(1 for line in path.read_bytes().splitlines() if json.loads(line))


def mcap_messages(path: Path) -> int:
    """Messages that a streaming reader finds, with or without the end of the file."""
    count = 0
    with path.open("rb") as file:
        try:
            for record in StreamReader(file).records:
                count += type(record).__name__ == "Message"
        except EndOfFile:
            pass
    return count


def npz_rows(path: Path) -> int:
    """Rows of a whole archive."""
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
    return len(np.load(path)["seq"])


def images(path: Path) -> int:
    """Images that are whole."""
    found = [cv2.imread(str(one)) for one in path.parent.glob(path.name.replace("%05d", "*"))]
    assert all(image is not None for image in found)
    return len(found)


def mosaic(path: Path) -> int:
    """Frames along which the mosaic extends."""
    return round((cv2.imread(str(path)).shape[1] - 320) / 2) + 1


# Branch behind the tee, file, frames in it.
SINKS: dict[str, tuple[str, str, Reader]] = {
    "filesink": ("filesink", "out.raw", lambda path: path.stat().st_size // (320 * 240)),
    "jpegsink": ("jpegsink", "image-%05d.jpg", images),
    "changemasksink": (
        "framediff motion=none name=d ! fakesink on-error=drop-branch d.mask ! changemasksink", "masks",
        lambda path: images(path / "bin%05d.png"),
    ),
    "videofilesink .mp4": ("videofilesink preset=ultrafast", "out.mp4", video_frames),
    "videofilesink .mkv": ("videofilesink preset=ultrafast", "out.mkv", video_frames),
    "packetsink .ts": ("encode live=true gop=20 ! packetsink", "packets.ts", video_frames),
    "packetsink .mp4": ("encode live=true gop=20 ! packetsink", "packets.mp4", video_frames),
    "packetsink .mkv": ("encode live=true gop=20 ! packetsink", "packets.mkv", video_frames),
    "packetsink .mp4, default encode": ("encode ! packetsink", "default.mp4", video_frames),
    "tracksink .jsonl, .csv, .txt": ("tracksink", "tracks.jsonl", json_lines),
    "tracksink .geojson": (
        "tracksink ground-altitude=500", "tracks.geojson",
        lambda path: sum(
            len(line["properties"]["coordTimes"]) for line in json.loads(path.read_bytes())["features"]
        ),
    ),
    "tracksink .kml": (
        "tracksink ground-altitude=500", "tracks.kml",
        lambda path: len(ElementTree.parse(path).findall(".//{*}coord")),
    ),
    "mcapsink": ("mcapsink", "tracks.mcap", mcap_messages),
    "detectionsink .jsonl, .txt": ("detectionsink", "found.jsonl", json_lines),
    "detectionsink .json (COCO)": (
        "detectionsink", "found.json", lambda path: len(json.loads(path.read_bytes())["images"])
    ),
    "featuresink .npz": ("featuresink", "features.npz", npz_rows),
    "featuresink .parquet": (
        "featuresink", "features.parquet", lambda path: pyarrow.parquet.read_table(path).num_rows
    ),
    "stitch location= save-interval=1": ("stitch save-interval=1", "mosaic.png", mosaic),
}  # fmt: skip


class Run:
    """One run of `launch` with all sinks, or one of them."""

    def __init__(
        self,
        folder: Path,
        names: list[str],
        count: int = 100_000,
        rate: float = RATE,
        options: Sequence[str] = (),
    ) -> None:
        self.folder = folder
        plugin = Path(tempfile.mkdtemp(prefix="endings-"))
        self.seen_path = plugin / "seen"
        (plugin / "endingsrc.py").write_text(SOURCE, encoding="utf-8")
        (plugin / "endings-1.dist-info").mkdir()
        (plugin / "endings-1.dist-info" / "entry_points.txt").write_text(
            "[streamkit.elements]\nendingsrc = endingsrc:EndingSrc\n", encoding="utf-8"
        )
        branches = "".join(f" t. ! queue ! {self._branch(name)}" for name in names)
        text = f"endingsrc seen={self.seen_path} count={count} rate={rate} ! tee name=t {branches}"
        text += " t. ! queue ! fakesink"
        self.log = (plugin / "log").open("w+")
        paths = os.pathsep.join([str(plugin), os.environ.get("PYTHONPATH", "")])
        self.process = subprocess.Popen(
            [BINARY, "launch", *options, text], stderr=self.log, env={**os.environ, "PYTHONPATH": paths}
        )

    def _branch(self, name: str) -> str:
        text, file, _ = SINKS[name]
        behind = " ! fakesink on-error=drop-branch" if text.startswith("stitch") else " on-error=drop-branch"
        return f"{text} location={self.folder / file}{behind}"

    def seen(self) -> int:
        """Frames that the source has given."""
        try:
            return int(self.seen_path.read_bytes() or 0)
        except (OSError, ValueError):
            return 0

    def play_for(self, seconds: float) -> None:
        """Waits until the source has given as many frames."""
        while self.seen() < seconds * RATE and self.process.poll() is None:
            time.sleep(0.01)

    def end(self, number: signal.Signals | None) -> str:
        """Sends a signal, or waits for the end; returns what was printed."""
        if number is not None:
            self.process.send_signal(number)
        self.process.wait(60)
        with self.log:
            self.log.seek(0)
            return self.log.read()


def lost(name: str, folder: Path, seen: int) -> str:
    """What a file lacks of the frames seen: "nothing", or seconds, or "everything"."""
    _, file, read = SINKS[name]
    try:
        seconds = (seen - read(folder / file)) / RATE
    except Exception as error:
        return f"everything ({type(error).__name__})"
    return "nothing" if seconds <= 2 / RATE else f"{seconds:.1f} s"


def lost_seconds(loss: str) -> float:
    """The length of a loss in s; infinite where everything is lost."""
    if loss == "nothing":
        return 0.0
    return math.inf if loss.startswith("everything") else float(loss.removesuffix(" s"))


@contextmanager
def mounted(options: str) -> Iterator[Path]:
    """A file system of its own."""
    folder = Path(tempfile.mkdtemp(prefix="endings-"))
    subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)], check=True)
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def by_signal(number: signal.Signals, times: int, *options: str) -> dict[str, str]:
    """The largest loss of each sink over runs of `launch` that end with a signal at random moments."""
    found: dict[str, list[str]] = {name: [] for name in SINKS}
    for _ in range(times):
        with tempfile.TemporaryDirectory() as text:
            run = Run(Path(text) / "new" / "folder", list(SINKS), options=options)
            run.play_for(random.uniform(*MOMENTS_S))
            seen = run.seen()
            run.end(number)
            for name, cells in found.items():
                cells.append(lost(name, Path(text) / "new" / "folder", seen))
    return {name: max(cells, key=lost_seconds) for name, cells in found.items()}


def on_a_full_disk(name: str) -> str:
    """What is left where the disk becomes full: as much as fits, as a share of what was given until then."""
    with mounted("size=64k" if name == "mcapsink" else "size=400k") as folder:
        run = Run(folder, [name], count=6000, rate=2000.0)
        log = run.end(None)
        error = "reported" if "No space left" in log or "has room" in log else "no error"
        cell = lost(name, folder, 0)
        return f"{error}, {cell if cell.startswith('everything') else 'the rest is readable'}"


def unwritable(name: str) -> str:
    """The error before the first frame."""
    with mounted("size=400k,ro") as folder:
        run = Run(folder, [name])
        log = run.end(None)
        return "refused at the start" if run.process.returncode == 1 and not run.seen() else log[:60]


def closed_pipe(name: str) -> str:
    """What reads the output ends."""
    with tempfile.TemporaryDirectory() as text:
        path = Path(text) / SINKS[name][1]
        if "%" in path.name or not path.suffix or path.suffix in (".npz", ".parquet", ".png"):
            return "no stream"
        os.mkfifo(path)
        run = Run(Path(text), [name], count=400, rate=200.0)
        with path.open("rb") as reader:
            reader.read(1)
        log = run.end(None)
        return "reported" if "Broken pipe" in log or "Illegal seek" in log else f"no error: {log[:200]}"


def table(kills: int) -> str:
    """The table as Markdown."""
    names = ("SIGINT", "SIGTERM", "SIGHUP")
    columns = {name: by_signal(signal.Signals[name], 1) for name in names}
    columns["SIGKILL"] = by_signal(signal.SIGKILL, kills)
    # Every run writes into a folder that is not there.
    made = {
        name: "not made" if loss.startswith("everything") else "made"
        for name, loss in columns["SIGTERM"].items()
    }
    columns["missing folder"] = made
    columns["full disk"] = {name: on_a_full_disk(name) for name in SINKS}
    columns["unwritable folder"] = {name: unwritable(name) for name in SINKS}
    columns["closed pipe"] = {name: closed_pipe(name) for name in SINKS}
    lines = ["| output | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for name in SINKS:
        lines.append(f"| {name} | " + " | ".join(column[name] for column in columns.values()) + " |")
    return "\n".join(lines)


def recorder(kills: int) -> str:
    """Kills a recorder of segments again and again; finished segments must stay, the open one nearly."""
    folder = Path(tempfile.mkdtemp(prefix="endings-"))
    SINKS["segments"] = (
        "encode live=true gop=10 ! packetsink max-size-time=1000000000", "rec-%05d.ts", video_frames
    )  # fmt: skip
    finished: dict[Path, str] = {}
    damaged, largest_s = 0, 0.0
    for _ in range(kills):
        before = set(folder.glob("rec-*.ts"))
        run = Run(folder, ["segments"])
        run.play_for(random.uniform(0.2, 2.5))
        seen = run.seen()
        run.end(signal.SIGKILL)
        damaged += sum(digest(path) != known for path, known in finished.items())
        new = sorted(set(folder.glob("rec-*.ts")) - before)
        frames = sum(video_frames(path) for path in new)
        largest_s = max(largest_s, (seen - frames) / RATE)
        finished |= {path: digest(path) for path in new}
    return (
        f"{kills} kills, {len(finished)} segments: {damaged} finished segments changed, "
        f"at most {largest_s:.2f} s of the open one lost"
    )


def digest(path: Path) -> str:
    """Of the content of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def main() -> None:
    """Prints the table, or the figures of the recorder."""
    random.seed(1)
    arguments = sys.argv[1:]
    if arguments[:1] == ["recorder"]:
        print(recorder(int(arguments[1]) if len(arguments) > 1 else RECORDER_KILLS))
    else:
        text = table(int(arguments[0]) if arguments else KILLS)
        before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
        PAGE.write_text(f"{before}{BEGIN}\n{text}\n{END}{rest.partition(END)[2]}", encoding="utf-8")
        print(text)


if __name__ == "__main__":
    main()
