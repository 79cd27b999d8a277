"""Numbers and times in the names of files."""

from pathlib import Path

import pytest

from streamkit.output.names import FileNames, local_path

NOON = 1_763_726_400 * 10**9  # 2025-11-21 12:00:00 UTC


@pytest.mark.parametrize(
    ("location", "name"),
    [
        ("a/flight.ts", "a/flight.ts"),
        ("a/flight-%05d.ts", "a/flight-00007.ts"),
        ("a/x-%d.ts", "a/x-7.ts"),
        ("a/flight-%Y%m%dT%H%M%SZ.ts", "a/flight-20251121T120000Z.ts"),
        ("a/%Y%m%d-%03d.ts", "a/20251121-007.ts"),
        ("a/100%.ts", "a/100%.ts"),
        ("file:///a%20b/c.ts", "/a b/c.ts"),
    ],
)
def test_names(location: str, name: str) -> None:
    """`%d` is a number, and the day beside other fields of a time."""
    assert str(FileNames(location).path(7, NOON)) == name
    assert FileNames(location).matches(Path(name))


def test_a_number_is_added_where_several_files_come() -> None:
    """Not where a number or a time tells them apart."""
    assert str(FileNames("a/x.ts", adds_number=True).path(3, NOON)) == "a/x-00003.ts"
    assert str(FileNames("a/%H.ts", adds_number=True).path(3, NOON)) == "a/12.ts"


def test_files_of_a_folder(tmp_path: Path) -> None:
    """Those of the pattern, with their numbers."""
    for name in ("x-00002.ts", "x-00010.ts", "x-a.ts", "x-00003.ts.arrivals.jsonl"):
        (tmp_path / name).touch()
    names = FileNames(f"{tmp_path}/x-%05d.ts")
    assert sorted(number for _, number in names.existing()) == [2, 10]
    assert not names.matches(tmp_path / "x-a.ts")
    assert list(FileNames("/nosuch/x-%05d.ts").existing()) == []


def test_local_path_reads_file_urls() -> None:
    """file:// URLs are decoded, paths are taken as they are."""
    assert local_path("file:///videos/my%20flight.mp4") == Path("/videos/my flight.mp4")
    assert local_path("videos/a%20b.mp4") == Path("videos/a%20b.mp4")
