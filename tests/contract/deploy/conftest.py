"""An sshd of the test's own, on loopback, with keys and settings in a temporary folder."""

from __future__ import annotations

import getpass
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

SSHD = shutil.which("sshd", path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin")
MISSING = [
    tool for tool, found in (("sshd", SSHD), *((t, shutil.which(t)) for t in ("ssh", "rsync", "make"))) if not found
]


@dataclass(frozen=True)
class Host:
    """Where to deploy to."""

    name: str
    port: int
    options: str


@pytest.fixture(scope="session")
def host(tmp_path_factory) -> Iterator[Host]:
    if MISSING:
        pytest.skip(
            f"no {', '.join(MISSING)} on this machine (apt-get install openssh-server openssh-client rsync make)"
        )
    folder = tmp_path_factory.mktemp("ssh")
    for name in ("host", "user"):
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", folder / name], check=True)
    (folder / "authorized").write_bytes((folder / "user.pub").read_bytes())
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    # What pip of this machine needs goes with the connection, as it would be set up on the Pi itself.
    passed = " ".join(f'"{key}={value}"' for key, value in os.environ.items() if key.startswith(("PIP_", "SSL_CERT")))
    (folder / "config").write_text(
        f"Port {port}\nListenAddress 127.0.0.1\nHostKey {folder}/host\nAuthorizedKeysFile {folder}/authorized\n"
        f"PidFile {folder}/pid\nStrictModes no\nUsePAM no\nPasswordAuthentication no\nPermitRootLogin yes\n"
        f"{f'SetEnv {passed}' if passed else ''}\n"
    )
    if os.getuid() == 0:
        Path("/run/sshd").mkdir(mode=0o755, exist_ok=True)
    daemon = subprocess.Popen([str(SSHD), "-D", "-e", "-f", folder / "config"], stderr=subprocess.PIPE)
    try:
        _await_listening(daemon, port)
        yield Host(
            f"{getpass.getuser()}@127.0.0.1",
            port,
            f"-i {folder}/user -o IdentitiesOnly=yes -o BatchMode=yes -o StrictHostKeyChecking=accept-new "
            f"-o UserKnownHostsFile={folder}/known",
        )
    finally:
        daemon.terminate()
        daemon.communicate(timeout=10)


def _await_listening(daemon: subprocess.Popen[bytes], port: int) -> None:
    deadline = time.monotonic() + 10.0
    while daemon.poll() is None and time.monotonic() < deadline:
        with socket.socket() as trial:
            if trial.connect_ex(("127.0.0.1", port)) == 0:
                return
    daemon.kill()
    pytest.fail(f"sshd does not listen: {daemon.communicate()[1].decode()}")
