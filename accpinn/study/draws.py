"""The answer's draws for other programs: a table of pandas, and a tree of xarray and ArviZ."""

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from accpinn.errors import ConfigError
from accpinn.inference.coordinates import parameters_of
from accpinn.inference.posterior import AT_SPEED
from accpinn.inference.window_posterior import window_posterior
from accpinn.model.cthp import Parameters
from accpinn.model.registry import FOLLOWING, time_gap
from accpinn.units import FloatArray

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import DataTree

    from accpinn.study.result import Result

MISSING = 'xarray is not installed; install it by pip install "accpinn[draws]".'
GAP = "time_gap_100_kmh"


def table(result: "Result") -> "DataFrame":
    """One row a draw; see `Result.draws`."""
    from pandas import DataFrame, concat  # takes a third of a second, which few need

    drawn = result.answer
    frames = []
    for kind, sets in (("typical", drawn.typical), ("further window", drawn.further)):
        for k, vehicle in enumerate(result.info.vehicles[1:]):
            columns = {name: drawn.values(sets, name)[:, k] for name in drawn.names}
            frame = DataFrame({"draw": np.arange(len(sets.alpha)), **columns})
            frame.insert(0, "name", result.info.names[k + 1])
            frame.insert(0, "vehicle", vehicle)
            frame.insert(0, "kind", kind)
            frames.append(frame)
    return concat(frames, ignore_index=True)


def can_be_tree() -> bool:
    """Whether the libraries for `tree` are installed."""
    return all(find_spec(name) for name in ("xarray", "h5netcdf", "h5py"))


def tree(result: "Result") -> "DataTree":
    """The draws as groups; see `Result.to_datatree`."""
    try:
        import xarray
    except ImportError:
        raise ConfigError(MISSING) from None

    answer, vehicles = result.answer, list(result.info.vehicles[1:])
    names = {"vehicle_name": ("vehicle", list(result.info.names[1:]))}

    def dataset(sets: Parameters, **coordinates: Any) -> Any:
        """Sets (draw, .., vehicle) by their names."""
        dims = ("chain", "draw", *coordinates, "vehicle")
        every = {name: answer.values(sets, name) for name in answer.names}
        every[GAP] = time_gap(answer.model, sets, AT_SPEED)
        units = {p.name: p.unit for p in FOLLOWING[answer.model].parameters} | {GAP: "s"}
        return xarray.Dataset(
            {name: (dims, values[None], {"units": units[name]}) for name, values in every.items()},
            {"chain": [0], "vehicle": vehicles, **coordinates, **names},
        )

    groups = {"posterior": dataset(answer.typical), "further_window": dataset(answer.further)}
    if result.segments:
        windows = [
            window_posterior(segment, result.analysis.case, answer.model, result.analysis.held)
            for segment in result.segments
        ]
        starts = [segment.window.start for segment in result.segments]
        drawn = np.array([window.drawn for window in windows])  # window, vehicle, draw, feature
        sets = parameters_of(answer.model, np.moveaxis(drawn, 2, 0), answer.speeds)
        groups["window_posterior"] = dataset(sets, window=starts)
        log: FloatArray = np.array([window.log_likelihood for window in windows])
        groups["window_log_likelihood"] = xarray.Dataset(
            {"speeds_and_gaps": (("chain", "draw", "window", "vehicle"),
                                 np.moveaxis(log, 2, 0)[None])},
            {"chain": [0], "window": starts, "vehicle": vehicles, **names},
        )  # fmt: skip
    found = xarray.DataTree.from_dict(groups)
    found.attrs = {
        "model": answer.model,
        "case": result.analysis.case,
        "source": result.info.source,
        "sha256": result.info.sha256,
        "accpinn": result.origin.accpinn,
    }
    return found


def to_netcdf(result: "Result") -> bytes:
    """The tree as a file in netCDF-4.

    Raises:
        ConfigError: where xarray is not installed.
    """
    return bytes(tree(result).to_netcdf(engine="h5netcdf"))
