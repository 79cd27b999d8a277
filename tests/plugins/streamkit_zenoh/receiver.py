"""Runs the pipeline given and prints the data of each frame, a line each; the tests' other process."""

import sys

from streamkit import Pipeline

with Pipeline.parse(sys.argv[1]) as pipeline:
    pipeline.play()
    for frame in pipeline["out"]:
        sys.stdout.write(bytes(frame.data).decode() + "\n")
