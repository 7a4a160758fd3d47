"""Learn the parameters of adaptive cruise control from car-following recordings.

    import accpinn

    result = accpinn.fit("recording.csv", start=0, duration=300)
    print(result)
    result.to_frame()                      # a row a follower, with intervals
    result.parameters.tau                  # array of time headways in s, one a follower
    result.posterior, result.uncertainty   # None where the method has no intervals
    result.stability, result.frequency_response([0.1, 0.2]), result.transfer_functions()
    accpinn.save(result, "result.accpinn.zip")

The public interface, in the order data flows:

    fit, compare, judge               a recording to a result; by several methods; models compared
    Analysis, Result, analyse, run    what is asked and what was found, and the way between them
    read, Recording, Window           a table of speeds and space-gaps
    from_arrays, from_frame           the same from arrays or a pandas frame
    sample, sample_path               recordings whose true parameters are known
    CsvMapping, TimeColumn,           which columns of any other table hold what
    SpeedColumn, GapColumn, ModeColumn, ByVehicle
    catalogue, download               the published runs, and their files
    cut, Segment                      a window of it and consecutive vehicles
    label_regimes, exclude_regimes    car-following, catching up, manual driving, standstill
    assess_quality                    excitation and mean time gap of a segment
    Parameters, Case                  α, β, τ of one or many vehicles
    ParameterSet, PUBLISHED           parameters with names; those printed in the paper
    FollowingModel, Parameter,        a car-following model of one's own
    register_model
    METHODS, Method, register_method  the registry of estimation methods
    Estimate, Posterior, ModelSpec    what a method returns, and the model that it is of
    History, Progress, Outcome        its course, a moment of it, and how it ended
    PinnConfig, preset                settings of the physics-inspired neural network
    evaluate, Evaluation              surrogate, closed-loop and hold-out errors
    stability_report, StabilityReport L₂ and L∞ string stability
    Margins                           how much the time gap exceeds the smallest stable one
    Waves                             growth of braking and accelerating waves, by their size
    what_if, WhatIf                   another time gap or delay, the acceleration ahead fed forward
    measured_gain, MeasuredGain       gain of a vehicle, from its recording by Welch's method
    transfer_function                 a vehicle as an object of python-control
    simulate_platoon, PlatoonRun      a platoon behind a leader, exact at every sample
    Sinusoid, SpeedStep, Brake,       leaders
    Recorded
    Uncertainty                       intervals and probabilities that follow from a posterior
    gap_band                          bands of the space-gaps that the posterior predicts
    next_drive, NextDrive             the drive of the car ahead that would tell most
    model_forms                       the CTHP beside further forms of the model
    Judgements                        how models describe windows that they have not seen
    starts, spread_of                 other initial values, and how far apart they end
    batch, read_study, group, Groups  many recordings on dask; their rows, and these by groups
    Store, Library                    results on disk
    save, load, verify, Verification  one file with all of a result
    report, render_report             a result as one web page
    Table, parameter_table            results as text, CSV, Markdown, LaTeX and HTML
    methods_table, stability_table
    models_table, pairs_table         judged models, one by one and in pairs
    sumo_types, parameter_card        parameters for SUMO, and with their provenance
    messages                          the sentences of a result's findings
    AccpinnError                      one sentence that names place, fault and cure

Each is loaded when it is first used, so that importing the package takes no time. Every function
checks its arguments first; vehicles are numbered from 1 as in the file, followers are places in
arrays, from 0.
"""

from typing import Any

import lazy_loader

__version__ = "0.1.0"

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    """A public name, loaded now; a function checks its arguments."""
    value = _load(name)
    is_function = getattr(value, "__name__", "") == name and not isinstance(value, type)
    if name in __all__ and is_function:
        from accpinn.arguments import checked_function

        value = globals()[name] = checked_function(value, name)
    return value
