"""Telemetry in a file of its own, beside the video: DJI subtitles or raw KLV."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from streamkit_decoder.telemetry import dji
from streamkit_decoder.telemetry.klv import KEY_PREFIX
from streamkit_decoder.telemetry.misb import MisbTelemetry
from streamkit_decoder.telemetry.sample import Sample

CHUNK_BYTES = 1 << 16
LARGEST_TEXT = 64 << 20


class NoTelemetry(ValueError):
    """A file holds nothing that tells a position."""


def read_telemetry(path: Path) -> list[Sample]:
    """The samples of a file, in its order, times from its beginning.

    Raises:
        NoTelemetry: there is not one position in it.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        is_klv = KEY_PREFIX in file.read(CHUNK_BYTES)
    samples = _klv_samples(path) if is_klv else _subtitle_samples(path)
    if not samples:
        raise NoTelemetry(
            f"{path}: no position in it; it must hold MISB ST 0601 packets with good checksums, "
            "or DJI subtitles"
        )
    return samples


def _subtitle_samples(path: Path) -> list[Sample]:
    with path.open("rb") as file:
        return list(dji.read_samples(file.read(LARGEST_TEXT).decode("utf-8", "replace")))


def _klv_samples(path: Path) -> list[Sample]:
    """Packets have no time of their own in a raw file but the platform's clock: the first one's is zero."""
    telemetry, samples = MisbTelemetry(), list[Sample]()
    with path.open("rb") as file:
        while data := file.read(CHUNK_BYTES):
            samples += telemetry.feed(data, 0)
    samples += telemetry.finish(0)
    clocked = [sample for sample in samples if sample.utc_ns is not None]
    zero = clocked[0].utc_ns if clocked else 0
    return [replace(sample, pts=(sample.utc_ns or 0) - (zero or 0)) for sample in clocked]
