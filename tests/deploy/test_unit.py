"""The systemd unit: accepted by systemd's parser, and its command speaks systemd's protocol."""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.slowness import patience

UNIT = Path(__file__).parents[2] / "deploy" / "streamkit@.service"
BINARY = Path(sys.executable).with_name("streamkit")
EXPOSURE_LIMIT = 30  # of 100; the unit has 20, most of it the network, which it needs
LATER = re.compile(r".*Unknown key '(RestartSteps|RestartMaxDelaySec)'.*")  # systemd 254 knows them


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
def test_systemd_accepts_the_unit(tmp_path: Path) -> None:
    """No unknown key or value, and little of the machine is exposed."""
    copy = tmp_path / UNIT.name
    copy.write_text(re.sub(r"/opt/\S+/streamkit", str(BINARY), UNIT.read_text("utf-8")))
    verified = analyze("verify", str(tmp_path / "streamkit@gate.service"))
    assert verified.returncode == 0, verified.stderr
    assert [line for line in verified.stderr.splitlines() if not LATER.match(line)] == []
    rated = analyze("security", "--offline=yes", f"--threshold={EXPOSURE_LIMIT}", str(copy))
    assert rated.returncode == 0, rated.stdout


def analyze(*words: str) -> subprocess.CompletedProcess[str]:
    """What systemd-analyze says."""
    command = ["systemd-analyze", "--no-pager", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=patience(30))


def test_its_command_notifies_systemd(tmp_path: Path) -> None:
    """READY once it plays, WATCHDOG while it does, STOPPING and exit code 0 after SIGTERM."""
    description = tmp_path / "gate.pipe"
    description.write_text("fakesrc is-live=true ! identity ! fakesink")
    found = re.search(r"^ExecStart=\S+ (.*)$", UNIT.read_text("utf-8"), re.MULTILINE)
    assert found
    line = found[1].replace("${METRICS}", "127.0.0.1:0").replace("$STREAMKIT_OPTIONS", "")
    words = line.replace("/etc/streamkit/%i.pipe", str(description)).split()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        systemd.settimeout(patience(30))
        environment = {**os.environ, "NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "1000000"}
        process = subprocess.Popen([BINARY, *words], env=environment, stderr=subprocess.DEVNULL)
        try:
            heard = [systemd.recv(100).decode() for _ in range(3)]
            process.send_signal(signal.SIGTERM)
            while heard[-1] != "STOPPING=1":
                heard.append(systemd.recv(100).decode())
            assert process.wait(patience(30)) == 0
        finally:
            process.kill()
            process.wait()
    assert heard[0] == "READY=1"
    assert set(heard[1:-1]) == {"WATCHDOG=1"}
