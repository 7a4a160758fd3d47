"""A small reverse proxy, which gives the app a public name, as docs/security.md describes it."""

import asyncio
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from urllib.parse import urlsplit

NAME = "app.lab.org"


@asynccontextmanager
async def proxy(app: str, name: str = NAME) -> AsyncIterator[str]:
    """The address of a proxy in front of an app; it passes on requests under its public name."""
    behind = urlsplit(app)

    served: set[asyncio.Task[None]] = set()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        served.add(asyncio.current_task())
        with suppress(OSError, asyncio.IncompleteReadError):
            head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1")
            head = re.sub(r"(?im)^(host: ).*?$", rf"\g<1>{name}\r", head, count=1)
            head = re.sub(r"(?im)^(origin: ).*?$", rf"\g<1>https://{name}\r", head, count=1)
            if "websocket" not in head.lower():  # one request a connection
                head = re.sub(r"(?im)^connection:.*\n", "", head)
                head = head.replace("\r\n", "\r\nConnection: close\r\n", 1)
            inner, outer = await asyncio.open_connection(behind.hostname, behind.port)
            outer.write(head.encode("latin-1"))
            await asyncio.gather(_pass_on(reader, outer), _pass_on(inner, writer))
        await _close(writer)

    listener = await asyncio.start_server(serve, "127.0.0.1", 0)
    async with listener:
        yield f"http://127.0.0.1:{listener.sockets[0].getsockname()[1]}"
    await asyncio.wait(served, timeout=5)  # all sides are closed by now


async def _close(writer: asyncio.StreamWriter) -> None:
    writer.close()
    with suppress(OSError):
        await writer.wait_closed()


async def _pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with suppress(OSError):
        while data := await reader.read(1 << 16):
            writer.write(data)
            await writer.drain()
    await _close(writer)
