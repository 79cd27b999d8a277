"""`make demo`: runs demo.pipe with a zenoh subscriber beside it, in a process of its own.

Prints what the subscriber receives, then where the pictures are.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import IO

HERE = Path(__file__).resolve().parent
STREAMKIT = [str(Path(sys.executable).with_name("streamkit"))]
LIMIT_S = 300
SHOW_EVERY = 25


def show(lines: IO[str], records: list[str]) -> None:
    """Prints every 25th record of the subscriber as it comes, with its targets; keeps the line of each."""
    for line in lines:
        if not line.startswith(" "):
            records.append(line)
        if len(records) % SHOW_EVERY == 1:
            print(f"  received: {line.rstrip()}", flush=True)


def main() -> int:
    """Runs publisher and subscriber; the exit code of the first that failed."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--output", type=Path, default=Path("out/demo"), help="folder for what it writes")
    arguments.add_argument("--frames", type=int, default=250, help="length of the flight")
    options = arguments.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)

    print("A camera flies over an aerial photograph; tracks of the cars come out of zenoh:", flush=True)
    subscriber = subprocess.Popen([*STREAMKIT, "subscribe", "demo/1"], stdout=subprocess.PIPE, text=True)
    assert subscriber.stdout is not None
    records: list[str] = []
    reader = threading.Thread(target=show, args=(subscriber.stdout, records))
    reader.start()
    settings = {"output": options.output, "frames": options.frames, "subscribers": 1}
    launch = [*STREAMKIT, "launch", "-f", str(HERE / "demo.pipe")]
    for name, value in settings.items():
        launch += ["--set", f"{name}={value}"]
    try:
        code = subprocess.run(launch, timeout=LIMIT_S, check=False).returncode
        code = subscriber.wait(timeout=30) or code
    except subprocess.TimeoutExpired:
        print(f"error: the demo has not ended within {LIMIT_S} s", file=sys.stderr)
        code = 1
    finally:
        subscriber.terminate()
        subscriber.wait(timeout=10)
        reader.join(timeout=10)
    if code == 0 and len(records) != options.frames:
        print(f"error: {options.frames} records were published, {len(records)} received", file=sys.stderr)
        code = 1
    if code == 0:
        print(f"{len(records)} records received; one per frame, none lost. Written:")
        for name in ("tracks.jpg", "mosaic.jpg", "tracks.jsonl"):
            print(f"  {options.output / name}")
        view = f"{os.path.relpath(STREAMKIT[0])} view --open {options.output / 'flight.mp4'}"
        print(f"Watch the same flight in the browser:\n  {view}")
    return code


if __name__ == "__main__":
    sys.exit(main())
