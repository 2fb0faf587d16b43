"""The screen in a browser, for a tablet beside the bed: textual-serve, with a token.

Whoever can open the page can start suction. So it listens on this computer only unless told
otherwise, and answers nobody who does not know the token, which is new with every start.
"""

from __future__ import annotations

import hmac
import importlib.util
import shlex
import sys
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skinlab.errors import InputError

if TYPE_CHECKING:
    from aiohttp import web

LOOPBACK = "127.0.0.1"
COOKIE = "skinlab"
_EXTRA = "the browser needs textual-serve: pip install 'skinlab[serve]'"

_Handler = Callable[["web.Request"], Awaitable["web.StreamResponse"]]


def page_url(host: str, port: int, token: str) -> str:
    """Return what to open in the browser."""
    shown = f"[{host}]" if ":" in host else host
    return f"http://{shown}:{port}/?token={token}"


def command_line(arguments: Sequence[str]) -> str:
    """Return what each page starts: this program with these arguments of `skinlab ui`."""
    return shlex.join([sys.executable, "-m", "skinlab", "ui", *arguments])


def serve(
    arguments: Sequence[str],
    *,
    host: str,
    port: int,
    token: str,
    tell: Callable[[str], None],
) -> None:
    """Serve until Ctrl+C; each page has a program of its own, one page at a time.

    Raises:
        InputError: textual-serve is not installed, or nothing can listen there.
    """
    if importlib.util.find_spec("textual_serve") is None:
        raise InputError(_EXTRA)
    server = _make_server(command_line(arguments), host, port, token)
    tell(page_url(host, port, token))
    try:
        server.serve()
    except OSError as error:
        raise InputError(f"{host} port {port}: {error.strerror or error}") from None


def _make_server(command: str, host: str, port: int, token: str) -> Any:
    import textual_serve.server
    from aiohttp import web

    folder = Path(textual_serve.server.__file__).parent

    @web.middleware
    async def guarded(request: web.Request, handler: _Handler) -> web.StreamResponse:
        """Let in who knows the token; the page remembers it as a cookie of this address only."""
        given = request.query.get("token", "")
        if request.path == "/" and hmac.compare_digest(given.encode(), token.encode()):
            response = web.HTTPFound("/")
            response.set_cookie(COOKIE, token, httponly=True, samesite="Strict")
            return response
        known = request.cookies.get(COOKIE, "")
        if not hmac.compare_digest(known.encode(), token.encode()):
            raise web.HTTPForbidden(text="open the address that skinlab printed, with its token\n")
        origin = request.headers.get("Origin")
        if origin is not None and origin != f"{request.scheme}://{request.host}":
            raise web.HTTPForbidden(text="this page is not for other sites\n")
        return await handler(request)

    class Server(textual_serve.server.Server):
        """Answers only with the token, and one page at a time."""

        open_pages = 0

        async def _make_app(self) -> web.Application:
            app = await super()._make_app()
            app.middlewares.append(guarded)
            return app

        async def on_startup(self, app: web.Application) -> None:
            """Say nothing: standard output is for the address."""

        async def handle_websocket(self, request: web.Request) -> web.WebSocketResponse:
            """Refuse a second page: there is one probe, and one who has it in hand."""
            if self.open_pages:
                raise web.HTTPConflict(text="another page is open; close it first\n")
            self.open_pages += 1
            try:
                return await super().handle_websocket(request)
            finally:
                self.open_pages -= 1

    shown = f"[{host}]" if ":" in host else host
    return Server(
        command,
        host=host,
        port=port,
        title="skinlab",
        public_url=f"http://{shown}:{port}",
        statics_path=folder / "static",
        templates_path=folder / "templates",
    )
