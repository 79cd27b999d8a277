"""The documented router accepts clients with a certificate, and gives each its rights only."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zenoh

from streamkit_zenoh.configuration import SessionFailure, SessionSettings
from streamkit_zenoh.session import close_session, open_session
from streamkit_zenoh.subscriber import TrackSubscriber
from streamkit_zenoh.wire.numbering import Stamp
from tests.acceptance.zenoh_links import BINARY, router
from tests.ports import free_port
from tests.waiting import wait_for

FOLDER = Path(__file__).parents[2] / "docs" / "examples" / "zenoh"
KEY = "uav/1"
COUNT = 20
Configured = Callable[[str], str]


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The certificates that the documented command makes."""
    folder = tmp_path_factory.mktemp("certificates")
    subprocess.run(["sh", str(FOLDER / "make-test-certificates.sh"), str(folder)], check=True, timeout=60)
    return folder


@pytest.fixture
def configured(certificates: Path, tmp_path: Path) -> Iterator[Configured]:
    """The documented router, at another port; returns the configuration file of a certificate's owner."""
    documented = zenoh.Config.from_file(str(FOLDER / "router-access.json5"))
    endpoint = f"tls/127.0.0.1:{free_port()}"
    tls = {
        "root_ca_certificate": str(certificates / "ca.pem"),
        "listen_certificate": str(certificates / "server.pem"),
        "listen_private_key": str(certificates / "server.key"),
        "enable_mtls": json.loads(documented.get_json("transport/link/tls/enable_mtls")),
    }

    def configuration(name: str) -> str:
        path = tmp_path / f"{name}.json5"
        own = {
            "root_ca_certificate": str(certificates / "ca.pem"),
            "connect_certificate": str(certificates / f"{name}.pem"),
            "connect_private_key": str(certificates / f"{name}.key"),
            "enable_mtls": True,
        }
        if name == "unknown":
            own = {"root_ca_certificate": own["root_ca_certificate"]}
        content = {"connect": {"endpoints": [endpoint]}, "transport": {"link": {"tls": own}}}
        path.write_text(json.dumps(content), encoding="utf-8")
        return str(path)

    access = json.loads(documented.get_json("access_control"))
    with router(endpoint, transport__link__tls=tls, access_control=access):
        yield configuration


def _forge(session: zenoh.Session, key: str) -> None:
    """Forged messages: a record with a number far ahead, and a status `ended`."""
    for stream in ("tracks", "status"):
        session.put(
            f"{key}/{stream}",
            b"{}",
            attachment=Stamp(1, 10**18).attachment(),
            congestion_control=zenoh.CongestionControl.BLOCK,
        )


def test_only_the_drone_publishes(configured: Configured) -> None:
    """The ground receives every record, in order and to the end; messages it forges reach no receiver."""
    forger = open_session(SessionSettings(config=configured("ground")))
    try:
        with TrackSubscriber(
            KEY, config=configured("ground"), ring=100, ends_with_publisher=True
        ) as subscriber:
            _forge(forger, KEY)
            text = (
                f"videotestsrc num-buffers={COUNT} ! zenohsink key={KEY} config={configured('drone')} "
                "wait-subscribers=1 wait-timeout-s=20 patience-s=5"
            )
            done = subprocess.run(
                [str(BINARY), "launch", "-q", text], capture_output=True, text=True, timeout=60, check=False
            )
            assert done.returncode == 0, done.stderr
            assert [record.seq for record in subscriber] == list(range(COUNT))
            counts = subscriber.counts
            assert (counts.bad, counts.lost, counts.jumps, counts.restarts) == (0, 0, 0, 0)
            assert not subscriber.has_vanished
    finally:
        close_session(forger, 5.0)


def test_the_drone_publishes_below_its_key_only(configured: Configured) -> None:
    """A hijacked drone cannot publish for another one; that it can for itself validates the test."""
    drone = open_session(SessionSettings(config=configured("drone")))
    try:
        with (
            TrackSubscriber("uav/2", config=configured("ground"), ring=100) as other,
            TrackSubscriber(KEY, config=configured("ground"), ring=100) as own,
        ):
            publisher = drone.declare_publisher(f"{KEY}/tracks")
            assert wait_for(lambda: bool(getattr(publisher.matching_status, "matching", False)))
            _forge(drone, "uav/2")
            _forge(drone, KEY)
            assert wait_for(lambda: own.counts.received == 1)
            assert other.counts.received == 0
    finally:
        close_session(drone, 5.0)


def test_a_client_without_certificate_is_refused(configured: Configured) -> None:
    """The error says so; without a certificate nothing is read or written."""
    with pytest.raises(SessionFailure, match=r"TLS is refused|Unable to connect"):
        open_session(SessionSettings(config=configured("unknown")))
    # A trusted client without policy is accepted and gets nothing.
    with (
        TrackSubscriber(KEY, config=configured("client"), ring=100) as outsider,
        TrackSubscriber(KEY, config=configured("ground"), ring=100) as insider,
    ):
        drone = open_session(SessionSettings(config=configured("drone")))
        try:
            publisher = drone.declare_publisher(f"{KEY}/tracks")
            assert wait_for(lambda: bool(getattr(publisher.matching_status, "matching", False)))
            _forge(drone, KEY)
            assert wait_for(lambda: insider.counts.received == 1)
            assert outsider.counts.received == 0
        finally:
            close_session(drone, 5.0)
