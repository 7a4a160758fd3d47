"""Public objects in a notebook: shown as they print on a terminal."""

from html import escape


class Displayed:
    """An object whose text is also its display in a notebook."""

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"
