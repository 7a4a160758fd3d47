"""Handling of every connection before a page: host name, limits, and the browser's cookie.

`app.py` gives `middleware` and `lifespan` to Streamlit when the server starts. Requests under a
name that `server.allowedHosts` does not have are refused, as Streamlit itself refuses WebSockets.
Every browser gets a cookie by which it is known again where nobody signs in. Connections are
bounded in number and in how long they may be silent, so that nobody can use up the descriptors that
files and databases need.
"""

import asyncio
import re
import secrets
import time
from collections import OrderedDict
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

import uvicorn
from starlette.datastructures import Headers, MutableHeaders
from starlette.middleware import Middleware
from starlette.requests import cookie_parser
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from streamlit import config
from streamlit.web.server.starlette.starlette_websocket import is_host_allowed
from uvicorn.protocols.http.auto import AutoHTTPProtocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from accpinn.units import Seconds

BROWSER = "accpinn_browser"
"""Name of the cookie by which the server recognises a browser."""
COOKIE_KEPT: Seconds = 365 * 24 * 3600.0
HEALTH, BEFORE_STREAM = "/_stcore/health", "/_stcore/host-config"
"""Ends of two paths: of what a monitor asks by any name, and of what a browser asks once, before it
opens its WebSocket."""
HEADERS = {
    "Content-Security-Policy": "frame-ancestors 'self'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",  # the address names the session
}
"""Headers of every answer that has none of its own of that name."""
CONNECTIONS, BURST, RESERVED = 1000, 256, 200
"""Most connections at a time; those that come at once, before any can be refused; and the
descriptors that are left for files whatever happens."""
SILENT: Seconds = 30.0
"""A connection is closed that sends nothing for so long: no whole request, no further byte of one
that has begun, or after a WebSocket's opening no first message."""
QUIET: Seconds = 1.0
IDLE: Seconds = 60.0
"""Where there are too many connections, one gives way to a new one: first one that has nothing
under way and was silent for the shorter time, then any that was for the longer."""
SWEEP: Seconds = 5.0
"""Time between two looks at all connections."""
LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})
_VALUE = re.compile(r"[\w-]{22}", re.ASCII)


def is_open() -> bool:
    """Whether others can reach the server: it listens to them, or has a name that they know."""
    names = {str(name).strip().lower() for name in config.get_option("server.allowedHosts")}
    address = str(config.get_option("server.address") or "")
    return not names or not {address, *names} <= LOOPBACK


def browser_of(cookies: str) -> str:
    """The value by which a browser is known, from its header `Cookie`; empty where it has none."""
    value = cookie_parser(cookies).get(BROWSER, "")
    return value if _VALUE.fullmatch(value) else ""


class Gate:
    """Refuses foreign names, and adds headers and the cookie to answers."""

    def __init__(self, app: ASGIApp) -> None:
        """Before the app."""
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request; WebSockets are Streamlit's to judge."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers, path = Headers(scope=scope), scope["path"]
        if not (is_host_allowed(headers.get("host")) or path.endswith(HEALTH)):
            refusal = PlainTextResponse("This server does not answer to that name.", 421)
            await refusal(scope, receive, send)
            return
        is_new = path.endswith(BEFORE_STREAM) and not browser_of(headers.get("cookie", ""))

        async def send_more(message: Message) -> None:
            if message["type"] == "http.response.start":
                answer = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    answer.setdefault(name, value)
                if is_new:
                    secure = "; Secure" if scope.get("scheme") == "https" else ""
                    answer.append(
                        "Set-Cookie",
                        f"{BROWSER}={secrets.token_urlsafe(16)}; Path=/; Max-Age={COOKIE_KEPT:.0f};"
                        f" HttpOnly; SameSite=Lax{secure}",
                    )
            await send(message)

        await self._app(scope, receive, send_more)


middleware = [Middleware(Gate)]


@dataclass(eq=False)
class Connection:
    """One connection: its protocol and when it began and was last heard."""

    protocol: Any
    """uvicorn's: of HTTP, or of a WebSocket once it is one."""
    heard: Seconds
    """When it last sent something that counts, by `time.monotonic`."""
    requests: int = 0
    """Requests or messages that it has sent."""


@dataclass(eq=False)
class Connections:
    """All connections of the server; everything here happens in its event loop."""

    most: int
    by_transport: OrderedDict[Any, Connection] = field(default_factory=OrderedDict)
    """Connections by their transports, the longest silent first."""

    def begin(self, protocol: Any, transport: Any) -> None:
        """Note a new connection, or that one has become a WebSocket; refuse one too many."""
        if transport.is_closing():
            return
        is_new = transport not in self.by_transport
        self.by_transport[transport] = Connection(protocol, time.monotonic())
        self.by_transport.move_to_end(transport)
        if is_new and len(self.by_transport) > self.most:
            self._least_missed(transport).abort()

    def _least_missed(self, newcomer: Any) -> Any:
        """The connection that makes room: one that has nothing under way, or has long been idle."""
        now = time.monotonic()
        others = [(transport, connection) for transport, connection in self.by_transport.items()
                  if transport is not newcomer]  # fmt: skip
        for transport, connection in others:
            if connection.heard < now - QUIET and _awaits(connection):
                return transport
        for transport, connection in others:
            if connection.heard < now - IDLE:
                return transport
        return newcomer

    def hear(self, transport: Any) -> None:
        """Note that a connection has sent something."""
        if connection := self.by_transport.get(transport):
            connection.heard = time.monotonic()
            self.by_transport.move_to_end(transport)

    def end(self, transport: Any) -> None:
        """Forget one that is closed."""
        self.by_transport.pop(transport, None)

    def sweep(self) -> None:
        """Close those that have been silent for too long."""
        before = time.monotonic() - SILENT
        for transport, connection in list(self.by_transport.items()):
            if connection.heard > before:
                return
            if _awaits(connection):
                transport.abort()


def _awaits(connection: Connection) -> bool:
    """Whether it is the other side's turn: a request is not whole, or no message came at all."""
    if isinstance(connection.protocol, WebSocketsSansIOProtocol):
        return not connection.requests
    cycle = connection.protocol.cycle
    return cycle is None or cycle.response_complete or cycle.more_body


def watch(connections: Connections) -> Callable[[], None]:
    """Have uvicorn's protocols report to `connections`; what is returned takes that back."""
    before: list[tuple[type, str, Any]] = []

    def follow(protocol: type, name: str, note: Callable[..., object]) -> None:
        former = getattr(protocol, name)

        def call(self: Any, *given: Any) -> Any:
            note(self, *given)
            return former(self, *given)

        before.append((protocol, name, former))
        setattr(protocol, name, call)

    def begin(protocol: Any, transport: Any) -> None:
        # After the protocol has taken the transport, which an end of it needs.
        asyncio.get_running_loop().call_soon(connections.begin, protocol, transport)

    def hear_message(protocol: Any, _: object) -> None:
        connections.hear(protocol.transport)
        if connection := connections.by_transport.get(protocol.transport):
            connection.requests += 1

    for protocol in (AutoHTTPProtocol, WebSocketsSansIOProtocol):
        follow(protocol, "connection_made", begin)
        follow(protocol, "connection_lost", lambda self, _: connections.end(self.transport))
    former = AutoHTTPProtocol.data_received

    def receive(protocol: Any, data: bytes) -> None:
        """A whole head counts, however it trickled in, and every byte of a body."""
        earlier = protocol.cycle
        former(protocol, data)
        cycle = protocol.cycle
        if cycle is not earlier or (cycle is not None and cycle.more_body):
            connections.hear(protocol.transport)

    before.append((AutoHTTPProtocol, "data_received", former))
    AutoHTTPProtocol.data_received = receive  # type: ignore[method-assign, assignment]
    for name in ("handle_text", "handle_bytes"):  # a pong is no sign of life of a user
        follow(WebSocketsSansIOProtocol, name, hear_message)

    def take_back() -> None:
        for protocol, name, former in before:
            setattr(protocol, name, former)

    return take_back


def most_connections() -> int:
    """How many this process can hold; its limit of descriptors is raised as far as it may be."""
    try:
        import resource
    except ImportError:  # Windows, where sockets are no descriptors
        return CONNECTIONS
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = CONNECTIONS + BURST + RESERVED
    if soft == resource.RLIM_INFINITY or soft >= wanted:
        return CONNECTIONS
    if hard == resource.RLIM_INFINITY or hard > soft:
        raised = wanted if hard == resource.RLIM_INFINITY else min(hard, wanted)
        with suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (raised, hard))
            soft = raised
    return max(soft - BURST - RESERVED, soft // 4)


def accept_few(server: type[uvicorn.Server]) -> None:
    """Have a server accept no more than `BURST` connections before it looks at them."""
    former = server.startup

    async def startup(self: uvicorn.Server, *given: Any, **named: Any) -> None:
        self.config.backlog = BURST
        await former(self, *given, **named)

    server.startup = startup  # type: ignore[method-assign]


@asynccontextmanager
async def lifespan(_: object) -> AsyncIterator[None]:
    """Watch over connections as long as the server lives."""
    connections = Connections(most_connections())
    take_back = watch(connections)

    async def sweep() -> None:
        while True:
            await asyncio.sleep(SWEEP)
            connections.sweep()

    sweeping = asyncio.create_task(sweep())
    try:
        yield
    finally:
        sweeping.cancel()
        take_back()
