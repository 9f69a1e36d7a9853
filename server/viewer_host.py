"""A viser server that only this process can reach: on a Unix socket in a private folder, without its GUI."""

import contextlib
import importlib
import io
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import viser
from viser import _messages as viser_messages
from websockets.asyncio.server import unix_serve


class _OnSocket(ModuleType):
    """Stands for the ``websockets`` package inside viser's server module; only ``serve`` differs: it takes a path."""

    def __init__(self, real: Any, path: Path) -> None:
        super().__init__(real.__name__)
        self.__dict__["_real"] = real

        def serve(handler: Callable[..., Any], _host: str, _port: int, **options: Any) -> Any:
            return unix_serve(handler, str(path), **options)

        server = ModuleType("websockets.asyncio.server")
        server.__dict__.update(vars(real.asyncio.server) | {"serve": serve})
        package = ModuleType("websockets.asyncio")
        package.__dict__.update(vars(real.asyncio) | {"server": server})
        self.__dict__["asyncio"] = package

    def __getattr__(self, name: str) -> Any:
        return getattr(self.__dict__["_real"], name)


def start_viser(path: Path) -> viser.ViserServer:
    """Return a viser server that listens on the Unix socket ``path`` (its folder must be private) and nowhere else.

    viser 1.1.1 has no authentication, binds every interface by default, and any client may change its GUI for all and
    open a public tunnel; hence the socket, and no share handlers.
    """
    infra: Any = importlib.import_module("viser.infra._infra")
    real = infra.websockets
    infra.websockets = _OnSocket(real, path)
    try:
        # It prints the address, which is nobody's business.
        with contextlib.redirect_stdout(io.StringIO()):
            server = viser.ViserServer(host="unix", port=0, verbose=False)
    finally:
        infra.websockets = real
    path.chmod(0o600)
    handlers = server._websock_server._incoming_handlers  # pyright: ignore[reportPrivateUsage]
    handlers.pop(viser_messages.ShareUrlRequest, None)
    handlers.pop(viser_messages.ShareUrlDisconnect, None)
    server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
    return server


def stop_viser(server: viser.ViserServer) -> None:
    """Stop the server and its threads."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()
