"""How a node reaches the bus: an endpoint in Zenoh's notation, and the certificates that a network needs."""

from dataclasses import dataclass
from pathlib import Path

from snakeslam.errors import InputError

UNIX, TLS, TCP = "unixsock-stream/", "tls/", "tcp/"
LOCAL = ("127.0.0.1", "localhost", "[::1]")


@dataclass(frozen=True, slots=True)
class Certificates:
    """PEM files of TLS between machines: the authority that both sides trust, and this side's own."""

    authority: Path
    certificate: Path
    key: Path


@dataclass(frozen=True, slots=True)
class Link:
    """How a node reaches the others: it listens at ``endpoint`` or connects to it."""

    endpoint: str
    listens: bool = False
    certificates: Certificates | None = None

    def __post_init__(self) -> None:
        where = "--listen" if self.listens else "--connect"
        kind, _, address = self.endpoint.partition("/")
        if f"{kind}/" not in (UNIX, TLS, TCP) or not address:
            raise InputError(where, f"{self.endpoint!r} is not an endpoint", "unixsock-stream/PATH, tls/HOST:PORT")
        if f"{kind}/" == TCP and address.rpartition(":")[0] not in LOCAL:
            raise InputError(where, f"{self.endpoint} would be open to all", "tls/HOST:PORT with certificates")
        if f"{kind}/" == TLS and self.certificates is None:
            raise InputError(where, f"{self.endpoint} needs certificates", "--ca, --cert and --key")
        if self.certificates is not None:
            for path in (self.certificates.authority, self.certificates.certificate, self.certificates.key):
                if not path.is_file():
                    raise InputError(where, f"{path}: no such file", "--ca, --cert and --key")


def unix_endpoint(folder: Path) -> str:
    """Return the endpoint of a socket in ``folder``."""
    return f"{UNIX}{folder / 'bus.sock'}"
