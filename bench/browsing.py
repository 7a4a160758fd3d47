"""A browser without a screen: one session of the app by Streamlit's own messages.

It sends the messages of a browser (the page, typed values, pressed buttons, files) and keeps the
elements of the page that come back. A fragment that asks to be drawn repeatedly is drawn when
`poll` is called.
"""

import asyncio
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

import requests
from streamlit.proto.BackMsg_pb2 import BackMsg
from streamlit.proto.ForwardMsg_pb2 import ForwardMsg
from streamlit.proto.WidgetStates_pb2 import WidgetState
from websockets.asyncio.client import ClientConnection, connect

from accpinn.units import Seconds

PATIENCE: Seconds = 600.0
"""Longest wait for one answer of a server that many use."""
Value = float | str | bool | tuple[str, ...]
"""Value of a field, a toggle or a row of segments."""
FIELDS = {bool: "bool_value", str: "string_value"}
"""The field of a widget's state by the value's type; numbers are in `double_value`."""
XSRF = "_streamlit_xsrf"


@dataclass(eq=False)
class Browser:
    """One session."""

    address: str
    session: str = ""
    """The app's name of the session, which stands in the address."""
    cookies: dict[str, str] = field(default_factory=dict)
    elements: dict[tuple[int, ...], Any] = field(default_factory=dict)
    """Elements of the page by their place."""
    faults: list[str] = field(default_factory=list)
    """Exceptions that a page showed."""
    sent_to: str = ""
    """Path to which the server sent the browser to sign in or out."""
    _socket: ClientConnection | None = None
    _pages: dict[str, str] = field(default_factory=dict)
    """Streamlit's hash of each page by its title."""
    _page: str = ""
    _server_session: str = ""
    _states: dict[str, WidgetState] = field(default_factory=dict)
    _polled: dict[str, float] = field(default_factory=dict)
    """Time between two drawings, by fragment."""

    async def open(self) -> Seconds:
        """Open the first page and return how long that took."""
        protocols = ["streamlit", *([self.cookies[XSRF]] if XSRF in self.cookies else ())]
        self._socket = await connect(
            f"ws{self.address.removeprefix('http')}/_stcore/stream",
            subprotocols=protocols,  # type: ignore[arg-type]
            origin=self.address,  # type: ignore[arg-type]
            additional_headers={
                "Cookie": "; ".join(f"{name}={value}" for name, value in self.cookies.items())
            },
            max_size=None,
            ping_interval=None,  # a browser asks nothing of a server that is busy
        )
        return await self._run(BackMsg())

    async def close(self) -> None:
        """Close the connection, as a closed browser does."""
        if self._socket:
            await self._socket.close()

    async def go(self, title: str) -> Seconds:
        """Turn to a page and return how long that took."""
        self._states.clear()
        message = BackMsg()
        message.rerun_script.page_script_hash = self._pages[title]
        return await self._run(message)

    async def press(self, key: str, **typed: float | str | bool) -> Seconds:
        """Fill in fields, press a button and return how long the answer took.

        Args:
            key: the button's key or label.
            typed: the fields' values by their keys.
        """
        for name, value in typed.items():
            self._type(name, value)
        message = self._message()
        widgets = message.rerun_script.widget_states.widgets
        widgets.add(id=self.widget(key).id, trigger_value=True)
        return await self._run(message)

    async def set(self, key: str, value: Value) -> Seconds:
        """Set a field, a toggle or a row of segments and return how long the answer took."""
        self._type(key, value)
        return await self._run(self._message())

    async def upload(self, key: str, name: str, content: bytes) -> Seconds:
        """Upload a file to a field and return how long it took until the page stood."""
        began = time.perf_counter()
        message = BackMsg()
        message.file_urls_request.request_id = name
        message.file_urls_request.file_names.append(name)
        message.file_urls_request.session_id = self._server_session
        await self._send(message)
        while (answer := await self._receive()).WhichOneof("type") != "file_urls_response":
            pass
        [urls] = answer.file_urls_response.file_urls
        await asyncio.to_thread(self._put, urls.upload_url, name, content)
        state = WidgetState(id=self.widget(key).id)
        state.file_uploader_state_value.uploaded_file_info.add(
            name=name, size=len(content), file_id=urls.file_id, file_urls=urls
        )
        self._states[state.id] = state
        await self._run(self._message())
        return time.perf_counter() - began

    async def poll(self) -> bool:
        """Draw the fragments that ask for it. Returns False if none does."""
        polled = list(self._polled.items())
        for fragment, interval in polled:
            await asyncio.sleep(interval)
            if fragment not in self._polled:  # the page was drawn anew by another one
                continue
            message = self._message()
            message.rerun_script.fragment_id = fragment
            message.rerun_script.is_auto_rerun = True
            await self._run(message)
        return bool(polled)

    def widget(self, key: str) -> Any:
        """Return the element with that key, or the button with that label.

        Raises:
            LookupError: the page has none.
        """
        for widget in self._contents():
            name = str(getattr(widget, "id", ""))
            if name and (name.endswith(f"-{key}") or getattr(widget, "label", "") == key):
                return widget
        raise LookupError(f"{key}: not on the page; {'; '.join(self.texts())[:500]}")

    def texts(self) -> list[str]:
        """Return the texts of the page."""
        kinds = "markdown", "alert", "heading", "text", "progress", "exception"
        parts = "body", "message", "text"
        return ["".join(getattr(text, part, "") for part in parts)
                for text in self._contents(*kinds)]  # fmt: skip

    def _contents(self, *kinds: str) -> Iterator[Any]:
        """Return what the elements of some kinds, or of all, contain."""
        for element in self.elements.values():
            kind = str(element.WhichOneof("type"))
            if not kinds or kind in kinds:
                yield getattr(element, kind, None)

    def _type(self, key: str, value: Value) -> None:
        state = WidgetState(id=self.widget(key).id)
        if isinstance(value, tuple):
            state.string_array_value.data.extend(value)
        else:
            setattr(state, FIELDS.get(type(value), "double_value"), value)
        self._states[state.id] = state

    def _message(self) -> BackMsg:
        """Return the message that runs the present page, with the values of the widgets on it."""
        message = BackMsg()
        message.rerun_script.page_script_hash = self._page
        shown = {getattr(widget, "id", "") for widget in self._contents()}
        states = (state for state in self._states.values() if state.id in shown)
        message.rerun_script.widget_states.widgets.extend(states)
        return message

    async def _run(self, message: BackMsg) -> Seconds:
        """Send a message and return how long the script took to end."""
        began = time.perf_counter()
        state = message.rerun_script
        state.query_string = f"session={self.session}" if self.session else ""
        state.context_info.color_scheme = "light"
        await self._send(message)
        while True:
            answer = await self._receive()
            if answer.WhichOneof("type") == "script_finished":
                if answer.script_finished != ForwardMsg.FINISHED_EARLY_FOR_RERUN:
                    return time.perf_counter() - began

    async def _send(self, message: BackMsg) -> None:
        assert self._socket
        await self._socket.send(message.SerializeToString())

    async def _receive(self) -> ForwardMsg:
        """Return the next message, after applying it to the page."""
        assert self._socket
        message = ForwardMsg()
        message.ParseFromString(await asyncio.wait_for(self._socket.recv(decode=False), PATIENCE))
        match message.WhichOneof("type"):
            case "new_session":
                self._begin(message.new_session, bool(message.metadata.run.fragment_ids))
            case "navigation":
                self._learn_pages(message.navigation.app_pages)
            case "delta":
                self._draw(tuple(message.metadata.delta_path), message.delta)
            case "auto_rerun":
                self._polled[message.auto_rerun.fragment_id] = message.auto_rerun.interval
            case "stop_auto_rerun":
                for fragment in message.stop_auto_rerun.fragment_ids:
                    self._polled.pop(fragment, None)
            case "auth_redirect":
                self.sent_to = message.auth_redirect.url
            case "page_info_changed":
                query = message.page_info_changed.query_string
                fields = dict(part.partition("=")[::2] for part in query.split("&"))
                self.session = fields.get("session", self.session)
        return message

    def _begin(self, session: Any, of_fragment: bool) -> None:
        self._server_session = session.initialize.session_id or self._server_session
        self._learn_pages(session.app_pages)
        self._page = session.page_script_hash
        if not of_fragment:
            self.elements.clear()
            self._polled.clear()

    def _learn_pages(self, pages: Iterable[Any]) -> None:
        for page in pages:
            title = "Home" if page.is_default else page.page_name.replace("_", " ")
            self._pages[title] = page.page_script_hash

    def _draw(self, place: tuple[int, ...], delta: Any) -> None:
        if delta.WhichOneof("type") != "new_element":
            for inner in [other for other in self.elements if other[: len(place)] == place]:
                del self.elements[inner]
            if delta.add_block.WhichOneof("type") == "popover":  # which opens as a widget
                self.elements[place] = delta.add_block
            return
        self.elements[place] = delta.new_element
        if delta.new_element.WhichOneof("type") == "exception":
            fault = delta.new_element.exception
            self.faults.append(f"{fault.type}: {fault.message}")

    def _put(self, url: str, name: str, content: bytes) -> None:
        base = urlsplit(self.address)._replace(path="").geturl()
        with requests.Session() as session:
            session.get(f"{base}/_stcore/health", timeout=PATIENCE)
            token = session.cookies.get(XSRF, "")
            headers = {"X-Xsrftoken": token} if token else {}
            answer = session.put(
                f"{base}{url}", files={name: (name, content)}, headers=headers, timeout=PATIENCE
            )
        with suppress(ValueError):
            answer.raise_for_status()


async def visit(address: str) -> None:
    """Open and close the first page of an app."""
    browser = Browser(address)
    await browser.open()
    await browser.close()
