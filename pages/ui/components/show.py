"""What a page shows: sentences, tables with downloads, charts and the key to colours; and widgets.

The widgets show what the workspace holds, and report a change through a callback.
"""

import html
import re
import time
from collections.abc import Callable, Collection, Container, Iterable, Mapping, Sequence
from typing import Any, Literal, TypeVar
from urllib.parse import urlsplit

import plotly.graph_objects as go
import streamlit as st

from accpinn.errors import AccpinnError
from accpinn.results.figures.style import (
    SHARED,
    on_paper,
    translucent,
    vehicle_colours,
    with_legend,
)
from accpinn.results.tables import STYLE, Table
from accpinn.results.tables.estimates import EVERY_FOLLOWER
from accpinn.segment import Segment, SegmentInfo
from accpinn.units import MetresPerSecond, Seconds
from pages.ui.session.users import is_shared
from pages.ui.session.workspace import Workspace

T = TypeVar("T")
Change = Callable[[Any], object]
"""Called with the new value, before the page is drawn anew."""
FORMATS = ("SVG", "PNG")
PICTURES = "frame_saved_as"
"""The entry in Streamlit's session state with the format in which charts are saved, and whether
every chart has a legend of its own."""
FLASH = "frame_flash"
"""The entry with the outcome of a click: kind, sentence, and when."""
IS_FLASHED = "frame_is_flashed"
"""The entry that tells whether a place on the page has shown it already."""
FLASH_FOR: Seconds = 20.0
KMH, SLOWEST = 3.6, 5.0
"""km/h of a m/s, and the lowest speed that can be chosen."""
SHOWN = 3
"""Warnings that are shown without being asked for."""
INK = 0.78
"""Opacity of a chart's text, as of captions; Streamlit's own grey is too faint on white."""
PNG_SCALE = 3
"""Scale of a PNG against the screen, so that it can be printed."""

_ADDRESS = re.compile(r"(?:https?:(?=//)|www(?=\.)|(?<=[\w.+-])@(?=[\w-]))", re.IGNORECASE)
"""Where an address begins that becomes a link, also with its punctuation escaped; see GFM."""
_PUNCTUATION = re.compile(r"([!-/:-@\[-`{-~])")
_UNIT = re.compile(r"(?<=\d) (?=(?:%|(?:s|m|dB|m/s|km/h|rad/s|times)\b))")
_ICONS = {"info": "info", "success": "check_circle", "warning": "warning", "error": "error"}


def escape_markdown(text: str) -> str:
    """Text with every mark that markdown could read made literal, and units beside their numbers.

    A line does not break between the two. Addresses, which Streamlit would make links of, are kept
    apart by an invisible sign.
    """
    apart = _ADDRESS.sub("\\g<0>\N{WORD JOINER}", text)
    return _PUNCTUATION.sub(r"\\\1", _UNIT.sub("\N{NO-BREAK SPACE}", apart))


def bullets(sentences: Sequence[str]) -> str:
    """Sentences as a list; a single one needs none."""
    if len(sentences) == 1:
        return escape_markdown(sentences[0])
    return "\n".join(f"- {escape_markdown(sentence)}" for sentence in sentences)


def messages(
    sentences: str | Sequence[str],
    kind: Literal["info", "success", "warning", "error"] = "info",
    icon: str = "",
) -> None:
    """Sentences in a box, shown literally; nothing where there is none.

    ``icon`` is a Material icon in place of the kind's own.
    """
    if sentences:
        said = bullets((sentences,) if isinstance(sentences, str) else sentences)
        getattr(st, kind)(said, icon=f":material/{icon or _ICONS[kind]}:")


def caption(text: str, about: str = "") -> None:
    """Text in small print, and more about it on hovering, both shown literally."""
    st.caption(escape_markdown(text), help=escape_markdown(about) or None)


def cautions(sentences: Sequence[str]) -> None:
    """Sentences in small print, each with a mark."""
    for said in sentences:
        st.caption(f":orange[:material/warning:] {escape_markdown(said)}")


def warnings(sentences: Sequence[str], about: str) -> None:
    """The first few openly, the rest on demand; ``about`` says what they are of."""
    messages(sentences[:SHOWN], "warning")
    if sentences[SHOWN:]:
        with st.expander(f"{len(sentences) - SHOWN} more about {about}"):
            st.markdown(bullets(sentences[SHOWN:]))


def not_acc(about: Segment | SegmentInfo, vehicles: Collection[int] | None = None) -> None:
    """In red, which followers a driver controls, of some by their numbers; nothing where none."""
    hand = about.driven_by_hand
    if hand and vehicles is not None:
        hand = hand.among(vehicles)
    if hand:
        messages(hand.sentence(about), "error", "front_hand")


def attempt(work: Callable[[], T]) -> T | None:
    """The result of some work; None, with the reason shown, where it is refused."""
    try:
        return work()
    except AccpinnError as fault:
        messages(str(fault), "error")
        return None


def flash(kind: Literal["success", "error"], sentence: str) -> None:
    """Keep a click's outcome for `flashed`; that of a refused callback is kept by the frame."""
    st.session_state[FLASH] = (kind, sentence, time.monotonic())


def forget_flash() -> None:
    """Show the last click's outcome no longer."""
    st.session_state.pop(FLASH, None)


def flashed() -> None:
    """The outcome of the last click, at the first place that asks; else the page's head has it.

    A second run right after the first must not swallow it.
    """
    if FLASH in st.session_state and not st.session_state[IS_FLASHED]:
        kind, sentence, since = st.session_state[FLASH]
        if time.monotonic() - since <= FLASH_FOR:
            messages(sentence, kind)
            st.session_state[IS_FLASHED] = True


def format_duration(seconds: Seconds) -> str:
    """A duration in words: 4 s, 3 min 20 s, 45 min, 1 h 5 min."""
    whole = max(1, round(seconds))
    if whole < 60:
        return f"{whole} s"
    if whole >= 600:  # a second more or less does not matter then
        whole = 60 * round(whole / 60)
    minutes, seconds = divmod(whole, 60)
    if minutes < 60:
        return f"{minutes} min {seconds} s" if seconds else f"{minutes} min"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min"


def table(table: Table, colours: Sequence[str] = ()) -> None:
    """Draw it, with a mark of colour before each row if ``colours`` are given."""
    st.html(STYLE + (table.coloured(colours) if colours else table).to_html())


def stem_of(text: str) -> str:
    """A text as the stem of a file's name: what is neither letter nor digit is an underscore."""
    return re.sub(r"[^\w-]+", "_", text).strip("_")


def downloads(table: Table, name: str, key: str) -> None:
    """A menu that saves the table as CSV or LaTeX, under a name."""
    stem = stem_of(name)
    kinds = (("CSV", table.to_csv(), "csv", "text/csv"),
             ("LaTeX", table.to_latex(), "tex", "application/x-tex"))  # fmt: skip
    with st.popover("Save the table", icon=":material/download:", key=f"{key}_save"):
        for label, text, ending, mime in kinds:
            st.download_button(
                label, text, f"{stem}.{ending}", mime, key=f"{key}_{ending}", on_click="ignore",
                type="tertiary",
            )  # fmt: skip


def address(path: str) -> None:
    """The address of something on this server, to be copied; ``path`` follows the server's name."""
    server = urlsplit(st.context.url or "")
    st.code(
        f"{server.scheme}://{server.netloc}/{path}" if server.netloc else f"/{path}", language=None
    )
    if not is_shared():
        st.caption("It works on this computer only; send somebody elsewhere a snapshot's file.")


def chart(figure: go.Figure, key: str, tools: Sequence[str] = (), **options: Any) -> Any:
    """Draw it; on hovering a button saves it as a picture named after ``key``.

    ``tools`` are plotly's names of further buttons, as "pan2d"; the options are those of Streamlit.
    """
    chosen, has_legend = st.session_state.get(PICTURES, (FORMATS[0], False))
    if has_legend:
        figure = with_legend(figure)
    side = st.context.theme.type
    if side and (text := st.get_option(f"theme.{side}.textColor")):
        paper = st.get_option(f"theme.{side}.backgroundColor")
        figure = on_paper(figure, paper, translucent(text, INK))
    chosen = chosen.lower()
    scale = PNG_SCALE if chosen == "png" else 1
    config = {
        "displaylogo": False,
        "modeBarButtons": [["toImage", *tools]],
        "toImageButtonOptions": {"format": chosen, "filename": f"accpinn_{key}", "scale": scale},
    }
    return st.plotly_chart(figure, key=key, config=config, **options)


def picture(figure: go.Figure, key: str) -> None:
    """Draw a small figure that answers to nothing."""
    st.plotly_chart(figure, key=key, config={"staticPlot": True})


def charts(
    drawn: Sequence[tuple[str, go.Figure]], page: str, widths: Sequence[float] = (1, 1)
) -> None:
    """Charts by name, in rows of columns, two by default; a narrow screen keeps their order."""
    for at in range(0, len(drawn), len(widths)):
        row = zip(st.columns(widths), drawn[at : at + len(widths)], strict=False)
        for column, (name, figure) in row:
            with column:
                chart(figure, f"{page}_{name}")


def key(
    entries: Iterable[tuple[str, str]],
    faint: Container[str] = (),
    dashed: str = "",
    dotted: str = "",
    title: str = "",
) -> None:
    """Names beside their colours, and what dashed and dotted lines mean; ``title`` comes first."""
    spans = [f"<span>{html.escape(title)}</span>"] if title else []
    spans += [
        f"<span{' class=faint' if name in faint else ''}>"
        f'<i style="background:{colour}"></i>{html.escape(name)}</span>'
        for name, colour in entries
    ]
    for line, meaning in (("- -", dashed), ("···", dotted)):
        if meaning:
            spans.append(f'<span><b aria-hidden="true">{line}</b> {html.escape(meaning)}</span>')
    st.html(f'<div class="vehicle-key">{"".join(spans)}</div>')


def follower_key(
    segment: Segment | SegmentInfo, with_truth: bool = False, shared: bool = False
) -> None:
    """The colour of each follower, once for all charts below.

    ``shared`` adds that of all followers together, as in Case I.
    """
    colours = vehicle_colours(segment.vehicles)
    entries = [*zip(segment.labels[1:], colours[1:], strict=True)]
    entries += [(EVERY_FOLLOWER, SHARED)] * shared
    key(entries, dashed="true value" if with_truth else "")


def clicked_data(points: list[dict[str, Any]]) -> Any:
    """What a chart's point carries that was clicked on; None where there is none."""
    data = points[0].get("customdata") if points else None
    return data[0] if isinstance(data, list) else data


# Widgets


def upload(label: str, key: str, took: Callable[[str, bytes], object], **look: Any) -> None:
    """A field for a file; ``took`` gets its name and its content once it is here."""

    def arrived() -> None:
        if file := st.session_state[key]:
            took(file.name, file.getvalue())

    st.file_uploader(label, key=key, on_change=arrived, **look)


def upload_several(label: str, key: str, took: Callable[[list[tuple[str, bytes]]], object],
                   **look: Any) -> None:  # fmt: skip
    """A field for files; ``took`` gets the names and contents of those that arrive together.

    The field goes on to hold the files that arrived before.
    """

    def arrived() -> None:
        before = st.session_state.setdefault(f"{key}_seen", set())
        new = [file for file in st.session_state[key] or () if file.file_id not in before]
        before.update(file.file_id for file in new)
        if new:
            took([(file.name, file.getvalue()) for file in new])

    st.file_uploader(label, key=key, on_change=arrived, accept_multiple_files=True, **look)


def choose_speed(
    workspace: Workspace, key: str, usual: MetresPerSecond, help: str
) -> MetresPerSecond:
    """A field in km/h for the speed at which models answer small disturbances."""
    speed: float = st.number_input(
        "Speed in km/h", SLOWEST, 250.0, step=5.0, width=160, format="%.0f", help=help,
        **kept(workspace, key, max(SLOWEST, float(round(KMH * usual)))),
    )  # fmt: skip
    return speed / KMH


def bound(key: str, value: object, change: Change, default: str = "value") -> dict[str, Any]:
    """Arguments with which a widget shows ``value``, whatever it showed before.

    The workspace is the one place where choices live: a widget reports a change through its
    callback and gets its value from here, so page switches and reloads lose nothing. It has the
    same value as its default, too: a browser that is still loading may miss the value set here,
    and would then report the default as the user's choice.

    A value that was chosen elsewhere comes with a new widget, whose key ends with a number. The
    browser may not have drawn it when the user clicks on something else; it then reports what the
    old widget shows, which is no choice.

    An emptied field changes nothing. ``default`` names the widget's argument for its default;
    empty if it needs another.
    """
    replaced = f"{key} replaced"
    times = st.session_state.get(replaced, 0)
    name = f"{key}_{times}" if times else key
    if name in st.session_state and st.session_state[name] != value:
        times = st.session_state[replaced] = times + 1
        name = f"{key}_{times}"
    if name not in st.session_state:
        st.session_state[name] = value

    def changed() -> None:
        new = st.session_state[name]
        if new is not None and st.session_state.get(replaced, 0) == times:
            change(new)

    return {"key": name, "on_change": changed} | ({default: value} if default else {})


def kept(workspace: Workspace, key: str, usual: object, default: str = "value") -> dict[str, Any]:
    """Arguments with which a widget shows what the workspace keeps under its key."""
    return bound(key, workspace.choices.get(key, usual), workspace.keep(key), default=default)


def _chosen(
    options: Mapping[T, str], value: T, key: str, change: Change | Workspace
) -> tuple[T, Change]:
    """What is chosen, and what keeps a change; a workspace keeps it among its choices."""
    if not isinstance(change, Workspace):
        return value, change
    chosen = change.choices.get(key, value)
    return chosen if chosen in options else value, change.keep(key)


def select(
    label: str,
    options: Mapping[T, str],
    value: T,
    key: str,
    change: Change | Workspace,
    labelled: bool = True,
    place: Any = st,
    **look: Any,
) -> T:
    """A select box, with what each option is called, in a column or container ``place``.

    Of a workspace in place of ``change``, ``value`` is the default, and the choice is kept there
    under ``key``. The label is read aloud also where it is not shown; ``look`` are Streamlit's
    further options. Returns what is chosen.
    """
    value, change = _chosen(options, value, key, change)
    labels, named = list(options.values()), dict[T, str]()
    for at, (option, said) in enumerate(options.items()):  # the browser reports what it reads
        earlier = labels[:at].count(said)
        named[option] = f"{said} ({earlier + 1})" if earlier else said
    place.selectbox(
        label,
        list(options),
        index=list(options).index(value),
        # The browser may still report an option that is gone.
        format_func=lambda option: named.get(option, str(option)),
        label_visibility="visible" if labelled else "collapsed",
        **bound(key, value, change, default=""),
        **look,
    )
    return value


def segments(
    label: str,
    options: Mapping[T, str],
    value: T,
    key: str,
    change: Change | Workspace,
    labelled: bool = False,
    **look: Any,
) -> T:
    """A segmented control; the arguments are those of `select`."""
    value, change = _chosen(options, value, key, change)
    st.segmented_control(
        label,
        list(options),
        format_func=options.__getitem__,
        required=True,
        label_visibility="visible" if labelled else "collapsed",
        **bound(key, value, change, default="default"),
        **look,
    )
    return value


def tabs(workspace: Workspace, key: str, views: Mapping[str, Callable[[], None]]) -> None:
    """Tabs of which only the open one is drawn; a switch draws the page anew.

    On a narrow screen they come after what is chosen on the page, and that after the result: what
    has a key that begins with "later_1" and so on stands below the rest there.
    """
    titles = {title: title for title in views}
    value, change = _chosen(titles, next(iter(titles)), key, workspace)
    with st.container(key=f"later_2_{key}"):
        drawn = st.tabs([*titles], **bound(key, value, change, default="default"))
    for tab, draw in zip(drawn, views.values(), strict=True):
        if tab.open:
            with tab:
                attempt(draw)


def pick(
    workspace: Workspace, names: Sequence[str], key: str, usual: int = 0, label: str = "Follower",
    **look: Any,
) -> int:  # fmt: skip
    """The index of one of several names, kept under ``key``; of a single one nothing is asked.

    ``look`` is as of `select`.
    """
    if len(names) == 1:
        return 0
    look = {"labelled": False, "width": 240} | look
    return select(label, dict(enumerate(names)), usual, key, workspace, **look)
