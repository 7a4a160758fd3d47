"""The session's own training beside the methods, where it was trained with other settings."""

from accpinn.methods.fit import Outcome
from accpinn.methods.registry import METHODS
from accpinn.study.comparison import MethodResult, result_of
from pages.ui.session.workspace import Workspace

ENDED = (Outcome.FINISHED, Outcome.CONVERGED)


def rows_of(workspace: Workspace) -> tuple[MethodResult, ...]:
    """The methods' rows, and one of the current PiNN where none of them is the same."""
    rows, fit, segment = workspace.compared, workspace.fit, workspace.segment
    if not rows or fit is None or segment is None:
        return rows
    known = any(row.fit.method == fit.method and row.fit.config == fit.config for row in rows)
    if known or not METHODS[fit.method].is_iterative or fit.outcome not in ENDED:
        return rows
    if workspace.own is None or workspace.own.fit is not fit:
        workspace.own = result_of(segment, fit, workspace.recording)
    return (*rows, workspace.own)
