"""The screen in a browser, for a tablet beside the bed: textual-serve, with a token.

Whoever can open the page can start suction. So it listens on this computer only unless told
otherwise, and answers nobody who does not know the token, which is new with every start.
The page is our own (templates/app_index.html): that of textual-serve asks Google for a font, and
where a network leads nowhere, nothing is shown until that has failed.
"""

from __future__ import annotations

import asyncio
import hmac
import importlib.util
import logging
import shlex
import socket
import sys
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skinlab.errors import InputError
from skinlab.text import needs

if TYPE_CHECKING:
    from aiohttp import web

LOOPBACK = "127.0.0.1"
COOKIE = "skinlab"
ALIVE_S = 0.5  # between two signs of life of the page
SILENT_S = 3.0  # without one: the page vents; a hidden page's timers come once a second
LEAVING_S = 15.0  # for which a page waits until the one before has vented and saved
VENT = "\x1b"  # Esc: vents in a field, too
# A tablet has no keys: class, words and bytes of the buttons under the screen
KEYS = (
    ("check", "F8 check", "\x1b[19~"),
    ("start", "F9 start", "\x1b[20~"),
    ("vent", "VENT", VENT),
    ("edit", "F3 edit", "\x1bOR"),
    ("session", "s session", "s"),
    ("visits", "F5 visits", "\x1b[15~"),
    ("help", "F1 help", "\x1bOP"),
    ("quit", "q quit", "q"),
)
_EXTRA = needs("the browser needs", "textual-serve", "serve")

_Handler = Callable[["web.Request"], Awaitable["web.StreamResponse"]]


def page_url(host: str, port: int, token: str) -> str:
    """Return what to open in the browser; where every address listens, by this computer's name."""
    name = socket.gethostname() if host in {"", "0.0.0.0", "::"} else host
    shown = f"[{name}]" if ":" in name else name
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
    try:
        with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as trial:
            # Before an address is told that leads to nothing, or to another server
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, sys.platform != "win32")
            trial.bind((host, port))
        tell(page_url(host, port, token))
        server.serve()
    except OSError as error:
        why = error.strerror or error
        raise InputError(
            f"{host} port {port}: {why}; expected an address of this computer and a free port "
            "(--serve-host, --serve-port)"
        ) from None


def _guard(token: str) -> Any:
    """Return a middleware that lets in who knows the token, and no page of another site."""
    from aiohttp import web

    @web.middleware
    async def guarded(request: web.Request, handler: _Handler) -> web.StreamResponse:
        """Hand on where the token is known; the page has it as a cookie of this address only."""
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

    return guarded


def _make_server(command: str, host: str, port: int, token: str) -> Any:
    import aiohttp_jinja2
    import textual_serve.server
    from aiohttp import web

    statics = Path(textual_serve.server.__file__).parent / "static"

    class Server(textual_serve.server.Server):
        """Answers only with the token, and one page at a time."""

        async def _make_app(self) -> web.Application:
            app = await super()._make_app()
            app.middlewares.append(_guard(token))
            self._one_page = asyncio.Lock()
            return app

        def initialize_logging(self) -> None:
            """Say what fails only: standard output is for the address."""
            logging.basicConfig(level=logging.WARNING)

        async def on_startup(self, app: web.Application) -> None:
            """Say nothing."""

        @aiohttp_jinja2.template("app_index.html")
        async def handle_index(self, request: web.Request) -> dict[str, Any]:
            """Give what our own page needs: it asks nothing of other computers."""
            size = request.query.get("fontsize", "")
            return {
                "application": {"name": self.title},
                "font_size": int(size) if size.isdecimal() else 16,
                "alive_ms": round(1000 * ALIVE_S),
                "keys": KEYS,
            }

        async def handle_websocket(self, request: web.Request) -> web.WebSocketResponse:
            """Refuse a second page: there is one probe, and one who has it in hand.

            A page that is opened again waits until the one before has vented and saved.
            """
            try:
                await asyncio.wait_for(self._one_page.acquire(), LEAVING_S)
            except TimeoutError:
                raise web.HTTPConflict(text="another page is open; close it first\n") from None
            try:
                return await super().handle_websocket(request)
            finally:
                self._one_page.release()

        async def _process_messages(self, websocket: Any, app_service: Any) -> None:
            heard: Any = _Heard(websocket)
            watch = asyncio.create_task(_vent_when_silent(heard, app_service))
            try:
                await super()._process_messages(heard, app_service)
            finally:
                watch.cancel()

    return Server(
        command,
        host=host,
        port=port,
        title="skinlab",
        statics_path=statics,
        templates_path=Path(__file__).parent / "templates",
    )


class _Heard:
    """A page's websocket that knows when it was heard last, in s of the loop's clock."""

    def __init__(self, websocket: Any) -> None:
        self._websocket = websocket
        self._now = asyncio.get_running_loop().time
        self._at_s = self._now()

    @property
    def silent_s(self) -> float:
        """For how long nothing has come."""
        return self._now() - self._at_s

    def __aiter__(self) -> _Heard:
        return self

    async def __anext__(self) -> Any:
        message = await self._websocket.__anext__()
        self._at_s = self._now()
        return message

    def __getattr__(self, name: str) -> Any:
        return getattr(self._websocket, name)


async def _vent_when_silent(heard: _Heard, app_service: Any) -> None:
    """Vent where the page is silent: asleep, hidden, or out of the network's reach."""
    vented = False
    while True:
        await asyncio.sleep(ALIVE_S)
        silent = heard.silent_s > SILENT_S
        if silent and not vented:
            await app_service.send_bytes(VENT.encode())
        vented = silent
