"""Files of track records, one JSON object a line, as tracksink writes them."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from streamkit.errors import StreamError
from streamkit.flow.record import TargetRecord, TrackRecord, decode_record

if TYPE_CHECKING:
    from numpy.typing import NDArray

COLUMNS = {
    "run": "i8", "epoch": "i8", "seq": "i8", "pts_ns": "i8", "capture_ns": "i8", "id": "i8", "state": "U16",
    "x": "f8", "y": "f8", "length": "f8", "width": "f8", "angle": "f8", "vx": "f8", "vy": "f8", "score": "f8",
    "age_ns": "i8", "lat": "f8", "lon": "f8", "error_m": "f8",
}  # fmt: skip
LINE_LIMIT_BYTES = 4 << 20  # as for a record received over zenoh
NO_TIME = -(2**63)  # `pts_ns` or `capture_ns` of a frame without one, in columns of int64


class RecordFile:
    """The records of a file, in order.

    Iterating yields each with the number of its run, from 1: another run begins with another source, whose
    records may stand between those of the first, and where epoch and frame number of a source do not go up.
    Its ids are other targets.

    Attributes:
        is_cut_off: whether the last line was only half written, as by a process that was killed; it is left
            out.

    Raises:
        OSError: the file cannot be read.
        StreamError: a line is no track record; names file and line.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.is_cut_off = False

    def __iter__(self) -> Iterator[tuple[int, TrackRecord]]:
        return ((run, record) for run, record, _ in self.lines())

    def lines(self) -> Iterator[tuple[int, TrackRecord, bytes]]:
        """Iterates with the line of each record, which may hold fields unknown to `TrackRecord`."""
        number, runs = 0, 0
        newest: dict[str, tuple[int, tuple[int, int]]] = {}  # run, epoch and frame number of each source
        with self.path.open("rb") as file:
            while line := file.readline(LINE_LIMIT_BYTES):
                number += 1
                if not line.strip():
                    continue
                try:
                    record = decode_record(line)
                except StreamError as error:
                    is_last = not line.endswith(b"\n") and not file.read(1)
                    if is_last and newest:
                        self.is_cut_off = True
                        return
                    remedy = "give a .jsonl file of tracksink; streamkit convert makes one of CSV or MOT"
                    raise StreamError(f"{self.path}:{number}: {error}; {remedy}") from None
                order = record.epoch, record.seq
                run, last = newest.get(record.source, (0, order))
                if order <= last:
                    run = runs = runs + 1
                newest[record.source] = run, order
                yield run, record, line.strip()


def read_tracks(path: str | Path) -> NDArray[Any]:
    """The targets of a file of track records as a table; `pandas.DataFrame(read_tracks(path))` takes it.

    Args:
        path: JSON lines from tracksink.

    Returns:
        A structured array with a row for each target and frame, in the order of the file: run (from 1),
        epoch, seq, pts_ns and capture_ns (UTC; -2**63 if unknown), id, state, x y length width (px of the
        frame), angle (rad), vx vy (px/s on the reference plane), score, age_ns, lat lon (WGS84 degrees),
        error_m. Other unknown numbers are NaN.

    Raises:
        OSError: the file cannot be read.
        StreamError: a line is no track record; names file and line.
    """
    import numpy as np

    rows = [_row(run, record, target) for run, record in RecordFile(path) for target in record.tracks]
    return np.array(rows, list(COLUMNS.items()))


def _row(run: int, record: TrackRecord, target: TargetRecord) -> tuple[object, ...]:
    found: dict[str, object] = {"run": run}
    for part in (record, target, target.geo):
        found |= {} if part is None else msgspec.structs.asdict(part)
    unknown = {"pts_ns": NO_TIME, "capture_ns": NO_TIME}
    values = ((name, found.get(name)) for name in COLUMNS)
    return tuple(unknown.get(name, math.nan) if value is None else value for name, value in values)
