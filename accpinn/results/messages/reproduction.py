"""What comes out of the paper's tables and figures here, in words."""

from accpinn.results.messages import joined
from accpinn.results.reproduction import PrintedItem, PrintedRun


def outcome(item: PrintedItem) -> str:
    """How the printed verdicts compare with those computed; empty where none are printed."""
    if not item.verdicts:
        return ""
    count = sum(2 * len(one.vehicles) for one in item.verdicts)
    agreeing = sum(one.agreeing for one in item.verdicts)
    said = f"{agreeing} of {count} printed verdicts agree by the paper's criteria."
    refuted = [name for one in item.verdicts for name in one.refuted]
    if refuted:
        are = "is" if len(refuted) == 1 else "are"
        said += (
            f" By the exact criterion {joined(refuted)} {are} not L∞ string stable: D > 0 is"
            " necessary, not sufficient."
        )
    return said


def run_line(run: PrintedRun) -> str:
    """The recording, window and vehicles that an item takes."""
    vehicles = f"vehicles {run.vehicles[0]}–{run.vehicles[-1]}"
    case = f", Case {run.case}" if len(run.vehicles) > 2 else ""
    return f"OpenACC {run.campaign}, {run.file}, {run.window}, {vehicles}{case}"
