"""The Ray of this machine starts, also where its own processes take too long at first, and ends."""

from pathlib import Path

import pytest

from streamkit import ResourceError
from streamkit_fleet import local_ray

FAKE = """#!/bin/sh
echo start >> "{starts}"
[ $(wc -l < "{starts}") -gt {failures} ] || exit 1
echo "This command will now block forever"
trap 'kill $!; exit' TERM
sleep 60 &
wait
"""


@pytest.fixture
def fake_ray(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Programs that stand in for Ray are written here; the file `starts` gets a line for each start."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    for name in ("RAY_AUTH_MODE", "RAY_AUTH_TOKEN_PATH", "RAY_worker_niceness"):
        monkeypatch.setenv(name, "")
    monkeypatch.setattr("streamkit_fleet.local_ray.sys.executable", str(tmp_path / "ray"))
    return tmp_path


def fail_at_first(folder: Path, failures: int) -> None:
    """Writes a Ray that ends at its first starts, and then stays."""
    program = folder / "ray"
    program.write_text(FAKE.format(starts=folder / "starts", failures=failures), encoding="ascii")
    program.chmod(0o700)


@pytest.mark.parametrize("failures", [0, 1])
def test_ray_is_started_once_more_where_it_ends_at_once(fake_ray: Path, failures: int) -> None:
    """It is there after the call, and gone after `end`."""
    fail_at_first(fake_ray, failures)
    local = local_ray.start()
    try:
        assert local_ray.known() == local
        assert len((fake_ray / "starts").read_text().splitlines()) == failures + 1
    finally:
        local_ray.end(local)
    assert local_ray.known() is None


def test_a_ray_that_ends_twice_is_an_error(fake_ray: Path) -> None:
    """The error names the file with its messages."""
    fail_at_first(fake_ray, 9)
    with pytest.raises(ResourceError, match=r"has ended while it started; .*ray\.log holds its messages"):
        local_ray.start()
    assert len((fake_ray / "starts").read_text().splitlines()) == local_ray.STARTS
