"""What a file of an archive needs: its content's hash, and parts that begin at keyframes."""

from __future__ import annotations

import hashlib
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import av
import msgspec


@dataclass(frozen=True, slots=True)
class BatchRecipe:
    """What is done with every file.

    Attributes:
        text: description with `${input}` and `${output}`.
        variables: values of its other variables.
        suffix: of the results, ".jsonl".
        part_s: longest part of a file, s; 0 does not split.
        overlap_s: by how much a part begins before the end of the one before, s.
    """

    text: str
    variables: dict[str, str]
    suffix: str
    part_s: float
    overlap_s: float


@dataclass(frozen=True, slots=True)
class ClipPart:
    """A part of a file, s from its beginning.

    Attributes:
        begin_s: first frame processed, a keyframe; it lies before the end of the part before, so that targets
            seen in both can be matched.
        end_s: end; None is the file's.
    """

    begin_s: float = 0.0
    end_s: float | None = None


@dataclass(frozen=True, slots=True)
class Plan:
    """A file and its parts; `key` is the hash of its content, its path and the recipe."""

    path: str
    key: str
    duration_s: float
    parts: tuple[ClipPart, ...]


def plan_file(path: str, recipe: BatchRecipe) -> Plan:
    """Reads a file once for its hash, and once more for its keyframes if it is to be split.

    Raises:
        OSError: the file cannot be read.
    """
    with Path(path).open("rb") as file:
        content = hashlib.file_digest(file, "sha256")
    content.update(msgspec.json.encode((path, recipe), order="sorted"))
    key = content.hexdigest()
    try:
        with av.open(path) as container:
            duration_s = (container.duration or 0) / av.time_base
        splits = recipe.part_s and duration_s > 1.5 * recipe.part_s
        parts = (
            split(keyframes_s(path), duration_s, recipe.part_s, recipe.overlap_s) if splits else (ClipPart(),)
        )
    except (av.FFmpegError, IndexError):  # the pipeline says why it cannot be read
        return Plan(path, key, 0.0, (ClipPart(),))
    return Plan(path, key, duration_s, parts)


def keyframes_s(path: str) -> list[float]:
    """Times of the keyframes of a file's first video, s from the first frame."""
    with av.open(path) as container:
        stream = container.streams.video[0]
        first, keyframes = None, []
        for packet in container.demux(stream):  # none is kept: a long file would fill the memory
            if packet.pts is None:
                continue
            first = packet.pts if first is None else min(first, packet.pts)
            if packet.is_keyframe:
                keyframes.append(packet.pts)
        return sorted((pts - (first or 0)) * float(stream.time_base or 0) for pts in keyframes)


def split(
    keyframes: Sequence[float], duration_s: float, part_s: float, overlap_s: float
) -> tuple[ClipPart, ...]:
    """Parts of at least `part_s` that begin and end at keyframes, s; one if there are too few keyframes."""
    ends, last_s = list[float](), 0.0
    while (index := bisect_left(keyframes, last_s + part_s)) < len(keyframes):
        last_s = keyframes[index]
        if duration_s - last_s < part_s / 2:  # the rest is no part of its own
            break
        ends.append(last_s)
    begins = [0.0, *(keyframes[max(0, bisect_right(keyframes, end - overlap_s) - 1)] for end in ends)]
    return tuple(map(ClipPart, begins, [*ends, None]))
