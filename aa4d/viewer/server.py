"""viser's server, at an address that is free, and without its tunnel."""

from __future__ import annotations

import contextlib
import io
import socket

import viser

from aa4d.errors import InputError

LARGEST_PORT = 65535


class Server(viser.ViserServer):
    """Without viser's tunnel: no page that finds this one can ask for it to be put on the internet."""

    def request_share_url(self, verbose: bool = True) -> str | None:  # noqa: ARG002
        return None


def serve(host: str, port: int) -> Server:
    """
    Raises:
        InputError: nothing can listen there.
    """
    check_free(host, port)  # viser would take the next free port, and say so in passing
    with contextlib.redirect_stdout(io.StringIO()):
        return Server(host=host, port=port, label="aa4d view", verbose=False)


def check_free(host: str, port: int) -> None:
    """Raises InputError where nothing can listen."""
    if not 0 <= port <= LARGEST_PORT:  # A look-up may take the lower 16 bits of more, and viser waits for ever
        raise InputError(f"--port {port}: must be from 0 to {LARGEST_PORT}; 0 for any that is free")
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{host}:{port}: cannot listen there ({reason}); choose another --port or --host") from None
