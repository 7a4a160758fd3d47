"""Car-following models side by side, and the parameters that each has."""

import numpy as np

from accpinn.channels import LINF_GAIN, MAGNITUDE
from accpinn.results.tables.stability import answer
from accpinn.results.tables.table import Cell, Column, Range, Table, estimate_cells
from accpinn.stability.report import stability_at
from accpinn.study.judge import Judgement, difference, wins
from accpinn.units import MetresPerSecond

MODEL = Column("Model", key="model")
LEFT_OUT = "In windows left out"


def judged_table(judged: Judgement, speed: MetresPerSecond) -> Table:
    """A row a model, the best first: errors in windows left out, |H|, and stability at a speed.

    The range beyond the best is one standard error about the mean of the ratios.
    """
    ranked, windows = judged.ranked, len(judged.windows)
    keys = (score.model.key for score in judged.scores)
    shares = dict(zip(keys, wins([judged]), strict=True))
    beyond: list[Cell] = [None]
    for score in ranked[1:]:
        mean, error = difference([score], ranked[:1])
        ends = np.round(100.0 * np.expm1([mean - error, mean + error])) + 0.0  # no -0
        beyond.append(Range(*ends.tolist()))
    vehicles = [stability_at(s.model, s.theta, speed) for s in ranked]
    at = f"At {3.6 * speed:.0f} km/h"
    return Table.of(
        f"{judged.info.labels[1]}: models in {windows} windows left out",
        [
            (MODEL, [score.model.title for score in ranked]),
            (Column("Gap RMSE", "m", 2, LEFT_OUT), [np.median(s.rmse) for s in ranked]),
            (Column("Beyond the best", "%", 0, LEFT_OUT), beyond),
            (
                Column("Best in", "%", 0, LEFT_OUT),
                [100 * shares[s.model.key] for s in ranked],
            ),
            (Column("Collides in", "%", 0, LEFT_OUT), [100 * s.collided.mean() for s in ranked]),
            (Column("|H| off", "dB", 1), [score.gain_error for score in ranked]),
            (
                Column("Peak", "dB", MAGNITUDE.digits, at),
                [v.peak.db if v else None for v in vehicles],
            ),
            (Column("L₂ stable", group=at), [answer(v.l2) if v else None for v in vehicles]),
            (
                Column.of(LINF_GAIN, at, key="linf_gain"),
                [v.linf_gain if v else None for v in vehicles],
            ),
        ],
    )


def model_parameters_table(judged: Judgement) -> Table:
    """A row a parameter of each model, with its interval, and whether the data determine it."""
    rows = [
        (score, parameter, k)
        for score in judged.ranked
        for k, parameter in enumerate(score.model.parameters)
    ]
    values = np.array([(s.theta[k], s.lower[k], s.upper[k]) for s, _, k in rows])
    known = ["the data" if s.determined[k] else "other cars" for s, _, k in rows]
    return Table.of(
        f"{judged.info.labels[1]}: parameters by closed-loop simulation of all windows",
        [
            (MODEL, [score.model.title for score, _, _ in rows]),
            (Column("Parameter"), [parameter.symbol for _, parameter, _ in rows]),
            (Column("Value", digits=4), estimate_cells(*values.T)),
            (Column("Unit"), [parameter.unit for _, parameter, _ in rows]),
            (Column("Known from"), known),
        ],
    )
