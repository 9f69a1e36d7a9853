"""Start the dashboard: bind, announce the sign-in URL, serve until a signal ends it."""

import errno
import secrets
import signal
import socket
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic

import uvicorn
from fastapi import FastAPI

from server.app import ServerSettings, create_app
from server.auth import TOKEN_VARIABLE, token_from_environment, viewer_token_from_environment
from server.edge import BACKLOG, Connections, most_connections, protocol_with
from server.logs import configure_logs
from snakeslam.claims import temporary_folder
from snakeslam.config import Config
from snakeslam.errors import InputError, SnakeslamError
from snakeslam.garbage import collect_seldom
from snakeslam.runtime.assembly.spec import SessionSpec
from snakeslam.runtime.bus.socket_path import check_socket_paths
from snakeslam.runtime.process.priority import set_server_priority

GRACE_S = 2
CONNECTIONS_EVERY = 10
"""In tenths of a second: how often idle connections are searched for."""
SWITCH_S = 0.0005
"""So soon another thread has its turn: those of the bus and the event loop must not wait for one that computes."""
MAX_MESSAGE_BYTES = 64 * 1024


def bind(host: str, port: int) -> socket.socket:
    """Return a listening socket; InputError when the address cannot be had."""
    try:
        family, kind, proto, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except socket.gaierror as error:
        raise InputError(f"--host {host}", "is no address of this machine") from error
    listener = socket.socket(family, kind, proto)
    # An old connection that fades out must not keep a restarted server from its port.
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind(address)
        listener.listen(BACKLOG)
    except OSError as error:
        listener.close()
        if error.errno == errno.EADDRINUSE:
            raise InputError(f"--port {port}", "is in use", "another port, or 0 for a free one") from error
        if error.errno in (errno.EACCES, errno.EPERM):
            raise InputError(f"--port {port}", "is not permitted", "1024 to 65535, or 0 for a free one") from error
        raise InputError(f"--host {host}", f"cannot be bound: {error.strerror}") from error
    return listener


class _Server(uvicorn.Server):
    """Reports when it is ready; brings the robot to a hold before it disconnects its clients."""

    def __init__(self, app: FastAPI, connections: Connections, ready: Callable[[], None]) -> None:
        super().__init__(_uvicorn(app, connections))
        self._app, self._connections, self._ready = app, connections, ready

    async def on_tick(self, counter: int) -> bool:
        if counter % CONNECTIONS_EVERY == 0:
            self._connections.close_idle(monotonic())
        return await super().on_tick(counter)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        await self._app.state.keeper.hold()
        await super().shutdown(sockets)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started and not self.should_exit:
            self._ready()


def serve(config: Config, *, host: str, port: int, recordings: list[Path], spec: SessionSpec | None = None) -> None:
    """Serve the dashboard until SIGINT or SIGTERM; InputError when it cannot start.

    ``spec`` replaces the simulator session of ``config``.
    """
    configure_logs()
    given, watching = token_from_environment(host), viewer_token_from_environment()
    token = given or secrets.token_urlsafe(24)
    spec = spec or SessionSpec(config, autostart=config.run.autostart)
    sys.setswitchinterval(SWITCH_S)
    with bind(host, port) as listener, temporary_folder("snakeslam-") as folder:
        # viser never returns where it cannot bind, and the bus's folder beside this one has the longer name.
        check_socket_paths(folder.with_name("snakeslam-bus-12345678"), ["viewer.sock", "bus.sock"])
        set_server_priority()
        url = _url(host, listener)
        settings = ServerSettings(spec, token, host, folder, tuple(recordings), viewer_token=watching)
        app = create_app(settings, lambda code: _say(f"Sign in elsewhere: {url}/login?code={code}"))
        hint = f"${TOKEN_VARIABLE}" if given else str(_write_token(folder, token))

        def ready() -> None:
            collect_seldom()
            _say(f"Token for scripts: {hint}")
            _say(f"Open {url}/login?code={app.state.auth.code}")

        server = _Server(app, Connections(most_connections()), ready)
        with _quiet_signals():
            server.run(sockets=[listener])
        if not server.started:
            raise SnakeslamError("the server did not start; the lines above say why")


def _uvicorn(app: FastAPI, connections: Connections) -> uvicorn.Config:
    return uvicorn.Config(
        app,
        http=protocol_with(connections),
        backlog=BACKLOG,
        log_config=None,
        ws_per_message_deflate=False,
        ws_max_size=MAX_MESSAGE_BYTES,
        timeout_graceful_shutdown=GRACE_S,
        server_header=False,
        proxy_headers=False,
    )


@contextmanager
def _quiet_signals() -> Generator[None]:
    """uvicorn raises the signal that ended it once more; by then there is nothing left to do."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    previous = {number: signal.signal(number, _ignore) for number in numbers}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def _ignore(number: int, frame: object) -> None:
    """Take a signal and do nothing."""


def _write_token(folder: Path, token: str) -> Path:
    path = folder / "token"
    path.touch(mode=0o600)
    path.write_text(token + "\n")
    return path


def _url(host: str, listener: socket.socket) -> str:
    """Return the address to open: one that works on this machine when every interface is bound."""
    name = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(host, f"[{host}]" if ":" in host else host)
    return f"http://{name}:{listener.getsockname()[1]}"


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()
