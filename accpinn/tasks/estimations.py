"""Makers of tasks: a training, a comparison of all methods, and trainings from several starts."""

from collections.abc import Iterator
from dataclasses import replace

from accpinn.errors import AccpinnError
from accpinn.inference.multistart import Trial, multistart
from accpinn.methods.fit import Fit, Progress
from accpinn.methods.method import TaskContext
from accpinn.methods.pinn.config import STARTS, PinnConfig
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case
from accpinn.recordings.recording import Recording
from accpinn.segment.segment import Segment
from accpinn.study.comparison import MethodFailure, MethodResult, compare
from accpinn.tasks.request import TrainingRequest
from accpinn.tasks.task import Task


def training(owner: str, request: TrainingRequest) -> Task[Fit]:
    """A training of the PiNN.

    Args:
        owner: who asked.
        request: what is to be learned.
    """

    def steps(context: TaskContext) -> Iterator[Progress | Fit]:
        load_torch()
        from accpinn.methods.pinn.training import training as run

        fit = yield from run(
            request.segment,
            request.case,
            request.config,
            store=context.store,
            should_stop=context.should_stop,
            threads=context.threads,
            warm=request.warm,
        )
        yield fit

    return Task(owner, "training", steps, request=request)


def comparison(
    owner: str, segment: Segment, case: Case, recording: Recording | None = None
) -> Task[MethodResult | MethodFailure]:
    """All methods on one segment.

    Args:
        owner: who asked.
        segment: the data.
        case: "I" or "II".
        recording: the segment's; with it the methods are also tested outside the window.
    """

    def steps(context: TaskContext) -> Iterator[MethodResult | MethodFailure]:
        quiet = replace(context, on_progress=None)  # several fits make one result
        return compare(segment, case, recording=recording, context=quiet)

    methods = METHODS.values()
    names = tuple(method.title for method in methods)
    return Task(owner, "comparison", steps, names, [method.typical_seconds for method in methods])


def starts(owner: str, segment: Segment, case: Case, config: PinnConfig) -> Task[Trial]:
    """Trainings of one segment from five initial values.

    Args:
        owner: who asked.
        segment: the data.
        case: "I" or "II".
        config: of all trainings, but for the initial values.
    """

    def steps(context: TaskContext) -> Iterator[Trial]:
        return multistart(segment, case, config, context=context)

    names = tuple(f"start {k} of {len(STARTS)}" for k in range(1, len(STARTS) + 1))
    return Task(owner, "series of starts", steps, names, (1.0,) * len(names))


def load_torch() -> None:
    """Import the network's training, which takes a second or two the first time.

    Raises:
        AccpinnError: where PyTorch cannot be loaded.
    """
    try:
        import accpinn.methods.pinn.training  # noqa: F401
    except (ImportError, OSError) as fault:  # the latter for a library of another system
        raise AccpinnError(
            f"PyTorch, which trains the network, cannot be loaded ({str(fault)[:80]}); install the"
            " packages of requirements.txt again, then start the app anew."
        ) from fault
