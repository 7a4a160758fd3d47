"""A running estimation as a bar on standard error."""

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from math import isfinite
from typing import Any

from tqdm import tqdm

from accpinn.methods.estimate import OnProgress, Progress


@contextmanager
def share_bar() -> Iterator[Callable[[float, str], None]]:
    """A bar on standard error, where that is a terminal: the share of all work, and a text."""
    form = "{l_bar}{bar}|{postfix}"
    with tqdm(total=1.0, file=sys.stderr, bar_format=form, mininterval=0.2, disable=None) as bar:

        def show_share(share: float, text: str) -> None:
            bar.n = share
            bar.set_postfix_str(text, refresh=True)

        yield show_share


@contextmanager
def progress_bar(is_shown: bool | None = None) -> Iterator[OnProgress]:
    """A bar a phase on standard error: time left, value, parameters.

    By default it is shown where standard error is a terminal.
    """
    form = "{desc} {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt}{postfix}"
    with ExitStack() as opened:
        phase = ""
        bar: tqdm[Any] = tqdm(disable=True)

        def show_progress(now: Progress) -> None:
            nonlocal phase, bar
            if now.phase != phase:
                opened.close()
                phase, bar = now.phase, opened.enter_context(
                    tqdm(desc=now.phase, total=now.iterations, file=sys.stderr, bar_format=form,
                         mininterval=0.2, disable=None if is_shown is None else not is_shown)
                )  # fmt: skip
            bar.total = now.iterations
            bar.set_postfix_str(", ".join(_moment(now)), refresh=False)
            bar.update(now.iteration - bar.n)

        yield show_progress


def _moment(now: Progress) -> Iterator[str]:
    """Time left, log likelihood or loss, and the first parameters."""
    if now.left is not None:
        yield f"{tqdm.format_interval(now.left)} left"
    is_loss = isfinite(now.total)
    yield f"loss {now.total:.3g}" if is_loss else f"log likelihood {now.log_likelihood:.1f}"
    first = now.parameters[0]
    yield f"α={first.alpha:.4f} β={first.beta:.4f} τ={first.tau:.3f}"
