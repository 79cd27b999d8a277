"""Runs a pipeline and prints the data of each frame on a line; run as a process by the tests."""

import sys

from streamkit import Pipeline

with Pipeline.parse(sys.argv[1]) as pipeline:
    pipeline.play()
    for frame in pipeline["out"]:
        sys.stdout.write(bytes(frame.data).decode() + "\n")
