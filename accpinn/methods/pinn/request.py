"""Under which names the store keeps what a training learns, and what is there already.

This needs no torch: a page asks it before anything is trained.
"""

import hashlib
import json
from contextlib import suppress
from typing import TYPE_CHECKING

from accpinn.methods.pinn.config import METHOD_VERSION, PinnConfig
from accpinn.methods.store import Store
from accpinn.model.cthp import Case
from accpinn.segment.segment import Segment

if TYPE_CHECKING:
    from accpinn.methods.pinn.warm_start import WarmStart


def request_keys(
    segment: Segment, case: Case, config: PinnConfig, warm: "WarmStart | None" = None
) -> tuple[str, str]:
    """Content addresses of a request's result and of its checkpoint.

    Equal addresses mean equal data, settings and method. Where a longer training only goes on
    where a shorter one ends (`paper` without L-BFGS), both share a checkpoint.
    """
    settings: dict[str, object] = config.to_json()
    if warm:
        settings["started_from"] = warm.digest()
    resumable = settings.copy()
    if config.preset == "paper" and not config.lbfgs_iterations:
        del resumable["iterations"]
    return _address(segment, case, settings), _address(segment, case, resumable)


def resume_iteration(
    store: Store, segment: Segment, case: Case, config: PinnConfig, warm: "WarmStart | None" = None
) -> int | None:
    """The iteration from which a training of this request would go on; None where it is new.

    So is one that was stopped before its first iteration, and a finished one is in the store.
    """
    result_key, resume_key = request_keys(segment, case, config, warm)
    if store.has_fit(result_key):
        return None
    for key in (resume_key, result_key):
        state = store.load_state(key)
        if state is None:
            return None
        with suppress(KeyError, IndexError, TypeError, ValueError):
            last = int(state["history.rows"][-1][0])
            if last <= config.iterations + config.lbfgs_iterations:
                return last or None
    return None


def forget(
    store: Store, segment: Segment, case: Case, config: PinnConfig, warm: "WarmStart | None" = None
) -> None:
    """Drop the checkpoints that a training of this request would go on from."""
    for key in request_keys(segment, case, config, warm):
        store.drop_state(key)


def _address(segment: Segment, case: Case, settings: dict[str, object]) -> str:
    request = {
        "method": METHOD_VERSION,
        "segment": segment.info.digest,
        "case": case,
        "config": settings,
    }
    return hashlib.sha256(json.dumps(request, sort_keys=True).encode()).hexdigest()
