"""Retention: the oldest files beyond the limits are deleted, and no others."""

from pathlib import Path

import pytest

from streamkit.output.retention import Retention, RetentionLimits


def _written(folder: Path, number: int) -> Path:
    path = folder / f"{number}.ts"
    path.write_bytes(b"x" * 100)
    return path


@pytest.mark.parametrize(
    ("limits", "kept"),
    [
        (RetentionLimits(), "012345"),
        (RetentionLimits(max_files=2), "45"),
        (RetentionLimits(max_total_size=350), "345"),
        (RetentionLimits(max_age=10), "45"),
        (RetentionLimits(max_total_size=1), "5"),
    ],
)
def test_limits(tmp_path: Path, limits: RetentionLimits, kept: str) -> None:
    """The newest is kept in any case."""
    retention = Retention(limits, tmp_path)
    deleted = sum(retention.add(_written(tmp_path, number), now_s=number * 10.0) for number in range(6))
    assert deleted == 6 - len(kept)
    assert "".join(sorted(path.stem for path in tmp_path.iterdir())) == kept


def test_files_of_others_are_never_deleted(tmp_path: Path) -> None:
    """Neither one that existed before, nor one with the name of a deleted one."""
    (tmp_path / "old.ts").write_bytes(b"x")
    retention = Retention(RetentionLimits(max_files=1), tmp_path)
    retention.add(_written(tmp_path, 0), 0.0)
    replaced = tmp_path / "new"
    replaced.write_bytes(b"another")
    replaced.replace(tmp_path / "0.ts")
    assert retention.add(_written(tmp_path, 1), 1.0) == 0
    assert retention.add(_written(tmp_path, 2), 2.0) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0.ts", "2.ts", "old.ts"]


def test_the_ledger_knows_files_of_earlier_runs(tmp_path: Path) -> None:
    """And their companions; a ledger that was cut short is read as far as it goes."""
    ledger, limits = tmp_path / ".x.written", RetentionLimits(max_files=2)
    for number in range(4):
        companion = tmp_path / f"{number}.arrivals"
        companion.touch()
        Retention(limits, tmp_path, ledger).add(_written(tmp_path, number), float(number), companion)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        ".x.written", "2.arrivals", "2.ts", "3.arrivals", "3.ts",
    ]  # fmt: skip
    ledger.write_text(ledger.read_text()[:-5])
    Retention(limits, tmp_path, ledger).add(_written(tmp_path, 4), 4.0)
    assert not (tmp_path / "1.ts").exists()
