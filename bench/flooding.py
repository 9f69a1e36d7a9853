"""A crowd that asks as fast as it is answered: ``python -m bench.flooding URL KIND TOKEN CLIENTS`` until it is killed.

A program of its own, so that what is measured beside it does not share its interpreter.
"""

import asyncio
import contextlib
import sys
from urllib.parse import urlsplit

from websockets.asyncio.client import connect
from websockets.exceptions import WebSocketException
from websockets.typing import Subprotocol

from snakeslam.runtime.process.priority import set_normal_priority

READS = {
    "map.ply": "/api/v1/map.ply",
    "recordings": "/api/v1/recordings",
    "trajectory": "/api/v1/trajectory",
    "state": "/api/v1/state",
}
KINDS = (*READS, "estop", "sockets")
SOCKET_PATHS = ("/api/v1/telemetry", "/viewer")
REOPEN_S, PAUSE_S = 2.0, 0.05


def request(host: str, token: str, kind: str) -> bytes:
    """Return the request that is sent over and over."""
    line = "POST /api/v1/estop" if kind == "estop" else f"GET {READS[kind]}"
    return f"{line} HTTP/1.1\r\nHost: {host}\r\nAuthorization: Bearer {token}\r\nContent-Length: 0\r\n\r\n".encode()


async def read_answer(reader: asyncio.StreamReader) -> int:
    """Read one answer to its end; return its status."""
    head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1").lower()
    length = int(head.partition("content-length:")[2].split("\r\n")[0])
    while length:
        length -= len(await reader.read(min(length, 1 << 18))) or length
    return int(head.split()[1])


async def ask(url: str, token: str, kind: str) -> None:
    """Ask over one connection, again and again, and over another one once it has ended."""
    host = urlsplit(url)
    asked = request(host.netloc, token, kind)
    while True:
        with contextlib.suppress(OSError, ValueError, asyncio.IncompleteReadError):
            reader, writer = await asyncio.open_connection(host.hostname, host.port)
            while True:
                writer.write(asked)
                await read_answer(reader)
        await asyncio.sleep(PAUSE_S)


async def watch(url: str, token: str, path: str) -> None:
    """Open a websocket, read it for a while, and open another one."""
    protocols = [Subprotocol("viser-v1.1.1")] if path == "/viewer" else None
    bearer = {"Authorization": f"Bearer {token}"}
    while True:
        with contextlib.suppress(OSError, WebSocketException, TimeoutError):
            async with (
                connect(url + path, additional_headers=bearer, subprotocols=protocols, max_size=None) as socket,
                asyncio.timeout(REOPEN_S),
            ):
                while True:
                    await socket.recv()
        await asyncio.sleep(PAUSE_S)


async def flood(url: str, kind: str, token: str, clients: int) -> None:
    if kind == "sockets":
        url = url.replace("http://", "ws://")
        await asyncio.gather(*(watch(url, token, SOCKET_PATHS[k % 2]) for k in range(clients)))
    await asyncio.gather(*(ask(url, token, kind) for _ in range(clients)))


if __name__ == "__main__":
    address, what, credential, count = sys.argv[1:]
    set_normal_priority()
    asyncio.run(flood(address, what, credential, int(count)))
