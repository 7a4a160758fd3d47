"""Pictures that the browser draws itself from data sent once, and answers to without the server."""

from functools import cache
from pathlib import Path
from typing import Any

import streamlit.components.v2 as components

HERE = Path(__file__).parent


@cache
def picture(name: str) -> Any:
    """The component made of the files of that name in this folder and the shared drawing code."""
    css, js = ("".join(_text(f"{of}.{end}") for of in ("drawing", name)) for end in ("css", "js"))
    return components.component(f"accpinn_{name}", html=_text(f"{name}.html"), css=css, js=js)


@cache
def holder() -> Any:
    """The component that keeps a chart's last picture while the next one is put up."""
    return components.component("accpinn_held", js=_text("held.js"))


def _text(file: str) -> str:
    return (HERE / file).read_text("utf-8")
