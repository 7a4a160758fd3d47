"""Learn the parameters of adaptive cruise control from car-following recordings.

    import accpinn

    study = accpinn.fit("recording.csv", start=0, duration=300)
    study.parameters.tau                   # array of time headways in s, one a follower
    study.uncertainty.lower, study.adequacy.forms, study.stability
    study.transfer_function()
    study.save("result.accpinn.zip")

The public interface, in the order data flows:

    fit, Study                        a recording to parameters, uncertainty, stability and files
    read, Recording                   a CSV file of speeds and space-gaps
    CsvMapping                        which columns of any other table hold what
    catalogue, download               the published runs, and their files
    cut, Segment                      a window of it and consecutive vehicles
    label_regimes, exclude_regimes    car-following, catching up, manual driving, standstill
    assess_quality                    excitation and mean time gap of a segment
    Parameters, Case                  α, β, τ of one or many vehicles
    ParameterSet, PUBLISHED           parameters with names; those printed in the paper
    METHODS, Method, Fit              the registry of estimation methods, and what they return
    PinnConfig, preset                settings of the physics-inspired neural network
    evaluate, Evaluation              surrogate, closed-loop and hold-out errors
    stability_report, StabilityReport L₂ and L∞ string stability
    measured_gain, MeasuredGain       of a vehicle, from its recording by Welch's method
    transfer_function                 of a vehicle, as an object of python-control
    simulate_platoon                  a platoon behind a leader, exact at every sample
    Sinusoid, SpeedStep, Brake        leaders
    intervals, Uncertainty            of the parameters and of what follows from them
    gap_band                          bands of the space-gaps that the posterior predicts
    profiles, model_forms, multistart identifiability, model adequacy, other initial values
    compare                           several methods on one segment
    fit_windows, JointFit             one parameter set over several windows, and their differences
    batch, read_study, group          many recordings on dask; their rows, and these by groups
    load, save, verify, Snapshot      one file with all of a result
    render_report                     a snapshot as one web page
    Table, parameter_table            results as text, CSV, LaTeX and HTML
    methods_table, stability_table
    sumo_types, parameter_card        parameters for SUMO, and with their provenance
    messages                          the sentences of a result's findings
    AccpinnError                      one sentence that names place, fault and cure

Each is loaded when it is first used, so that importing the package takes no time.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from accpinn.api import Study as Study
    from accpinn.api import fit as fit
    from accpinn.api import load as load
    from accpinn.api import verify as verify
    from accpinn.errors import AccpinnError as AccpinnError
    from accpinn.evaluation.evaluation import Evaluation as Evaluation
    from accpinn.evaluation.evaluation import evaluate as evaluate
    from accpinn.inference.identifiability import profiles as profiles
    from accpinn.inference.intervals import Uncertainty as Uncertainty
    from accpinn.inference.intervals import intervals as intervals
    from accpinn.inference.model_adequacy import model_forms as model_forms
    from accpinn.inference.multistart import multistart as multistart
    from accpinn.inference.prediction import gap_band as gap_band
    from accpinn.methods.fit import Fit as Fit
    from accpinn.methods.method import Method as Method
    from accpinn.methods.pinn.config import PinnConfig as PinnConfig
    from accpinn.methods.pinn.config import preset as preset
    from accpinn.methods.registry import METHODS as METHODS
    from accpinn.model.cthp import Case as Case
    from accpinn.model.cthp import Parameters as Parameters
    from accpinn.model.published import PUBLISHED as PUBLISHED
    from accpinn.model.published import ParameterSet as ParameterSet
    from accpinn.platoon.leader import Brake as Brake
    from accpinn.platoon.leader import Sinusoid as Sinusoid
    from accpinn.platoon.leader import SpeedStep as SpeedStep
    from accpinn.platoon.simulation import simulate_platoon as simulate_platoon
    from accpinn.recordings.catalogue import catalogue as catalogue
    from accpinn.recordings.download import download as download
    from accpinn.recordings.files import read as read
    from accpinn.recordings.mapping import CsvMapping as CsvMapping
    from accpinn.recordings.recording import Recording as Recording
    from accpinn.results.export import parameter_card as parameter_card
    from accpinn.results.export import sumo_types as sumo_types
    from accpinn.results.messages import messages as messages
    from accpinn.results.report import render_report as render_report
    from accpinn.results.snapshot import Snapshot as Snapshot
    from accpinn.results.snapshot.saved import save as save
    from accpinn.results.tables.estimates import methods_table as methods_table
    from accpinn.results.tables.estimates import parameter_table as parameter_table
    from accpinn.results.tables.stability import stability_table as stability_table
    from accpinn.results.tables.table import Table as Table
    from accpinn.segment.cut import cut as cut
    from accpinn.segment.quality import assess_quality as assess_quality
    from accpinn.segment.quality import exclude_regimes as exclude_regimes
    from accpinn.segment.quality import label_regimes as label_regimes
    from accpinn.segment.segment import Segment as Segment
    from accpinn.stability.frequency import transfer_function as transfer_function
    from accpinn.stability.measured_gain import MeasuredGain as MeasuredGain
    from accpinn.stability.measured_gain import measured_gain as measured_gain
    from accpinn.stability.report import StabilityReport as StabilityReport
    from accpinn.stability.report import stability_report as stability_report
    from accpinn.study.batch import batch as batch
    from accpinn.study.comparison import compare as compare
    from accpinn.study.groups import group as group
    from accpinn.study.groups import read_study as read_study
    from accpinn.study.windows import JointFit as JointFit
    from accpinn.study.windows import fit_windows as fit_windows

__version__ = "0.1.0"

_HOMES = {
    "api": "Study fit load verify",
    "errors": "AccpinnError",
    "evaluation.evaluation": "Evaluation evaluate",
    "inference.identifiability": "profiles",
    "inference.intervals": "Uncertainty intervals",
    "inference.model_adequacy": "model_forms",
    "inference.multistart": "multistart",
    "inference.prediction": "gap_band",
    "methods.fit": "Fit",
    "methods.method": "Method",
    "methods.pinn.config": "PinnConfig preset",
    "methods.registry": "METHODS",
    "model.cthp": "Case Parameters",
    "model.published": "PUBLISHED ParameterSet",
    "platoon.leader": "Brake Sinusoid SpeedStep",
    "platoon.simulation": "simulate_platoon",
    "recordings.catalogue": "catalogue",
    "recordings.download": "download",
    "recordings.files": "read",
    "recordings.mapping": "CsvMapping",
    "recordings.recording": "Recording",
    "results.export": "parameter_card sumo_types",
    "results.messages": "messages",
    "results.report": "render_report",
    "results.snapshot": "Snapshot",
    "results.snapshot.saved": "save",
    "results.tables.estimates": "methods_table parameter_table",
    "results.tables.stability": "stability_table",
    "results.tables.table": "Table",
    "segment.cut": "cut",
    "segment.quality": "assess_quality exclude_regimes label_regimes",
    "segment.segment": "Segment",
    "stability.frequency": "transfer_function",
    "stability.measured_gain": "MeasuredGain measured_gain",
    "stability.report": "StabilityReport stability_report",
    "study.batch": "batch",
    "study.comparison": "compare",
    "study.groups": "group read_study",
    "study.windows": "JointFit fit_windows",
}
_MODULE_OF = {name: module for module, names in _HOMES.items() for name in names.split()}

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'accpinn' has no attribute '{name}'")
    value = getattr(import_module(f"accpinn.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, loaded or not."""
    return [*__all__, "__version__"]
