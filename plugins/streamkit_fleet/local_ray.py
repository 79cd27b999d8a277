"""The connection to Ray: a cluster's, or one of this machine that outlives the command that started it."""

from __future__ import annotations

import logging
import os
import secrets
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec

from streamkit import ResourceError, needs_extra
from streamkit.output.file import write_whole

STARTS, START_LIMIT_S = 2, 60.0
STARTED = b"will now block"  # from what `ray start --block` prints last
END_LIMIT_S = 30.0
NAMESPACE = "streamkit"


class LocalRay(msgspec.Struct, frozen=True):
    """Address and process of the local Ray, and whether `down` has begun, as kept in a file."""

    address: str
    pid: int
    is_ending: bool = False


def _record() -> Path:
    base = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(base) / "streamkit" / "fleet.json"


def _token() -> Path:
    return _record().with_name("ray.token")


def use_token() -> None:
    """Makes Ray in this process, and what it starts, ask for and show the token of the local Ray.

    Ray listens on the machine's address: without a token, any host that reaches it could run programs here.
    """
    os.environ["RAY_AUTH_MODE"] = "token"
    os.environ["RAY_AUTH_TOKEN_PATH"] = str(_token())


def known() -> LocalRay | None:
    """The local Ray that runs, or None."""
    try:
        found = msgspec.json.decode(_record().read_bytes(), type=LocalRay)
    except (OSError, msgspec.DecodeError):
        return None
    return found if _is_running(found) else None


def _is_running(local: LocalRay) -> bool:
    """Whether its process is still that Ray and not another with its number."""
    try:
        return local.address.rpartition(":")[2].encode() in Path(f"/proc/{local.pid}/cmdline").read_bytes()
    except OSError:
        return False


def start(cores: int | None = None) -> LocalRay:
    """Starts Ray, protected by a new token, and waits until it has started.

    Ray ends if one of its own processes takes more than 15 s to begin, as on a busy machine; it is then
    started once more.

    Raises:
        ResourceError: it cannot be started, or has ended.
    """
    log = _record().with_name("ray.log")
    for _ in range(STARTS):
        try:
            process, local = _start_once(cores, log)
            deadline_s = time.monotonic() + START_LIMIT_S
            while process.poll() is None and time.monotonic() < deadline_s:
                if STARTED in log.read_bytes():
                    break
                time.sleep(0.05)
        except OSError as error:
            raise ResourceError(f"Ray cannot be started: {error}") from error
        if process.poll() is None:
            process.returncode = 0  # it outlives this process, which is no reason to warn
            return local
    raise ResourceError(f"Ray has ended while it started; {log} holds its messages")


def _start_once(cores: int | None, log: Path) -> tuple[subprocess.Popen[bytes], LocalRay]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    options = ["--head", "--block", f"--port={port}", "--include-dashboard=false", "--disable-usage-stats"]
    options += [f"--num-cpus={cores}"] if cores else []
    log.parent.mkdir(parents=True, exist_ok=True)
    token = os.open(_token(), os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with open(token, "w", encoding="ascii") as file_of_token:
        file_of_token.write(secrets.token_hex(32))
    use_token()
    os.environ.setdefault("RAY_worker_niceness", "0")  # its 15 leaves `nice` of a feed no room
    with log.open("wb") as messages:
        process = subprocess.Popen(
            [sys.executable, "-m", "ray.scripts.scripts", "start", *options],
            stdin=subprocess.DEVNULL, stdout=messages, stderr=messages, start_new_session=True,
        )  # fmt: skip
    local = LocalRay(f"127.0.0.1:{port}", process.pid)
    write_whole(_record(), msgspec.json.encode(local))
    return process, local


def begin_end(local: LocalRay) -> None:
    """Notes that the local Ray is about to end, so that no command connects to it any more."""
    write_whole(_record(), msgspec.json.encode(msgspec.structs.replace(local, is_ending=True)))


def end(local: LocalRay) -> None:
    """Ends the local Ray and all its processes.

    Raises:
        ResourceError: it did not end in time.
    """
    deadline_s = time.monotonic() + END_LIMIT_S
    if _is_running(local):
        os.kill(local.pid, signal.SIGTERM)
    while _is_running(local):
        if time.monotonic() > deadline_s:
            raise ResourceError(f"Ray (process {local.pid}) has not ended within {END_LIMIT_S:g} s")
        time.sleep(0.1)
    for file in (_record(), _token()):
        file.unlink(missing_ok=True)


@contextmanager
def connected(address: str | None, *, cores: int | None = None, wait_s: float = 0.0) -> Iterator[None]:
    """Context with a connection to Ray: the one there is, a cluster's, or a local one that ends with it.

    Args:
        address: HOST:PORT of a cluster, "auto" for the one on this machine, None to start one here.
        cores: of a local Ray; None is all.
        wait_s: how long to wait for a cluster that starts, s.

    Raises:
        ResourceError: Ray is missing, or the cluster does not answer.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    with needs_extra("this command", "fleet"):
        import ray
    if ray.is_initialized():
        yield
        return
    deadline_s = time.monotonic() + wait_s
    while address is not None and not _listens(address) and time.monotonic() < deadline_s:
        time.sleep(0.1)
    local: dict[str, Any] = {"num_cpus": cores, "include_dashboard": False} if address is None else {}
    try:
        ray.init(
            address or "local", log_to_driver=False, logging_level=logging.ERROR, namespace=NAMESPACE, **local
        )
    except (ConnectionError, RuntimeError, ValueError, ray.exceptions.RayError) as error:
        reason = str(error).partition("\n")[0]
        raise ResourceError(f"Ray at {address or 'this machine'} does not answer: {reason}") from error
    try:
        yield
    finally:
        ray.shutdown()


def _listens(address: str) -> bool:
    """Whether something takes connections at HOST:PORT."""
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host, int(port)), timeout=1.0).close()
    except (OSError, ValueError):
        return False
    return True


def cluster_cores() -> float:
    """Cores of the cluster."""
    import ray

    resources: dict[str, float] = ray.cluster_resources()  # type: ignore[no-untyped-call]
    return resources.get("CPU", 1.0)
