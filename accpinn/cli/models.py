"""`compare --models`: which car-following model describes each car, in windows left out."""

import argparse
import sys
from typing import Any

from tqdm import tqdm

from accpinn.cli.output import interruptible, show_result
from accpinn.cli.recording import chosen_recording
from accpinn.errors import ConfigError
from accpinn.model.registry import JUDGED, following_model
from accpinn.recordings.recording import Window
from accpinn.results.documents import judgement_document
from accpinn.results.messages import messages
from accpinn.results.tables.models import judged_table, model_parameters_table
from accpinn.segment.cut import DURATION
from accpinn.study.judge import Judgement, judge, subjects_of


def parse_models(text: str) -> tuple[str, ...]:
    """Keys of the registry, or those that are judged unless others are named.

    Raises:
        ConfigError: for an unknown one.
    """
    keys = JUDGED if text == "all" else tuple(part.strip() for part in text.split(","))
    return tuple(following_model(key).key for key in dict.fromkeys(keys))


def run_judge(options: argparse.Namespace) -> int:
    """Judge the models, and print a row for each; 130 when interrupted, with those that are done.

    Every window in car-following is left out in turn, unless a window is given: then its blocks.
    """
    models = parse_models(options.models)
    if options.leave_out:
        raise ConfigError("leave-out: models are judged on whole windows; leave --leave-out away.")
    recording = chosen_recording(options)
    asked = Window(options.start, options.start + options.duration)
    windows = [] if asked == Window(0.0, DURATION) else [asked]
    subjects = subjects_of(recording, options.vehicles, windows)
    with interruptible() as stopped:
        rounds = judge(subjects, models, stopped.is_set)
        bar = tqdm(rounds, total=len(models), unit="model", file=sys.stderr, disable=None)
        *_, judged = ((), *bar)
    if judged:
        show_result(options, _describe, _text, recording.source, judged)
    return 130 if stopped.is_set() else 0


def _describe(source: str, judged: tuple[Judgement, ...]) -> dict[str, Any]:
    return {"source": source, "vehicles": [*map(judgement_document, judged)]}


def _text(source: str, judged: tuple[Judgement, ...]) -> str:
    parts = []
    for car in judged:
        tables = judged_table(car, car.speeds[1]), model_parameters_table(car)
        parts += [table.to_text() for table in tables]
        parts.append("\n".join(messages(car.findings, car.info)))
    return "\n\n".join([source, *parts])
