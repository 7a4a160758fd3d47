"""Pictures that the browser draws itself from data sent once, and answers to without the server."""

from functools import cache
from pathlib import Path
from typing import Any

import streamlit.components.v2 as components

HERE = Path(__file__).parent


@cache
def picture(name: str) -> Any:
    """The component of the files of that name in this folder: .html, .css and .js."""
    html, css, js = ((HERE / f"{name}.{end}").read_text("utf-8") for end in ("html", "css", "js"))
    return components.component(f"accpinn_{name}", html=html, css=css, js=js)
