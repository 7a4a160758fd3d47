"""The gain from the speed ahead to a vehicle's own, estimated from its recording without a model.

With u the speed ahead and v the vehicle's, and spectral densities S averaged over n pieces of the
recording (Welch's method), the estimator H1, the coherence and the random error are

    Ĝ(ω) = S_uv / S_uu,   γ²(ω) = |S_uv|² / (S_uu S_vv),   ε = √(1 - γ²) / (|γ| √(2(n - 1)))

ε is the standard error of |Ĝ| relative to it, as that of a complex regression with n samples, and
the band is |Ĝ| exp(±tε) with Student's t of 2(n - 1) degrees of freedom. Of two signals that
have nothing in common, γ² is below 1 - p^(1/(n-1)) with probability 1 - p: where it is not above
that, the recording says nothing about the gain. Overlapping pieces are not independent; with the
window w and pieces of 2D samples that overlap by half, K of them count as

    n = K / (1 + 2 (1 - 1/K) ρ),   ρ = [Σ w(i) w(i+D) / Σ w(i)²]²

A disturbance of the vehicle itself widens the band but does not bias Ĝ, as the vehicle ahead does
not answer it; noise of the measured speed ahead makes Ĝ too small by S_uu / (S_uu + S_noise). The
band holds the random error only: a piece flattens what is narrower than 2π over its length. Speeds
are differenced first, which leaves the gain as it is and takes most of the slope from spectra that
fall steeply, so that less leaks from low frequencies to high ones.

**With a reference.** A car's gain is narrow beside what a piece of a window resolves, and its
response outlasts the piece: in windows of 300 s the peak of four simulated cars appears 2 dB too
low. So the recorded speed ahead is first passed through a model H of the car, or of all cars
between, and the gain from its answer v̂ to the recorded speed is measured. The product

    Ĝ(ω) = |H(jω)| |S_v̂v| / S_v̂v̂

is still measured, as a wrong H cancels, but only the ratio has to be resolved, which is about 1 and
flat. An H that resonates where the car does not is no help; what is not resolved lowers the
coherence, so the ratio is taken where more of the follower's motion is coherent by it.

Sources: Welch, IEEE Trans. Audio Electroacoust. 1967, for the average and n; Bendat and Piersol,
Random Data, 4th ed. 2010, chapter 9, for H1 and ε; Carter, Proc. IEEE 1987, for the coherence of
independent signals.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from accpinn.arguments import check_level
from accpinn.errors import ParameterError, SegmentError
from accpinn.model.cthp import Parameters, simulate
from accpinn.segment import Segment
from accpinn.segment.cut import BRIDGE
from accpinn.stability.criteria import checked, peaks, response
from accpinn.units import FloatArray, Mask, RadiansPerSecond, Seconds, frozen, stretches

LEVEL = 0.9
"""Default level of the band."""
SHARE = 0.25
"""Length of a piece as a share of the usable time; longer ones resolve more but are fewer."""
LONGEST: Seconds = 150.0
"""Longest piece; vehicles answer within a minute, and a finer resolution gains little."""
SHORTEST: Seconds = 20.0
"""Shortest piece; a shorter one resolves no frequency at which vehicles amplify."""
LEAST_PIECES = 4
"""Fewer averages leave a band without meaning."""
FASTEST: RadiansPerSecond = 3.0
"""Highest frequency given; receivers report a few times a second, and cars do little above it."""
CHANCE = 0.05
"""Probability with which independent signals appear coherent at a frequency."""


@dataclass(frozen=True, eq=False)
class MeasuredGain:
    """A follower's gain at K frequencies, from its recorded speed and that of the car ahead."""

    omega: FloatArray
    """(K,) in rad/s, above zero, evenly spaced."""
    response: NDArray[np.complex128]
    """(K,) Ĝ, from the speed ahead to the vehicle's own."""
    gain: FloatArray
    """(K,) |Ĝ|."""
    lower: FloatArray
    """(K,) lower end of the band."""
    upper: FloatArray
    """(K,) upper end of the band; infinite where nothing is known."""
    coherence: FloatArray
    """(K,) γ², 0 to 1."""
    coherent: Mask
    """(K,) where the coherence is above that of independent signals."""
    level: float
    """Probability with which the band covers the gain, as far as the error is random."""
    averages: float
    """n, the number of independent pieces that the average is worth."""
    pieces: int
    """Number of pieces."""
    length: Seconds
    """Length of a piece; frequencies are 2π over it apart."""

    @property
    def error(self) -> FloatArray:
        """(K,) ε, the standard error of ln |Ĝ|; infinite without coherence."""
        with np.errstate(divide="ignore"):
            odds = (1.0 - self.coherence) / self.coherence
        return np.asarray(np.sqrt(odds / (2.0 * (self.averages - 1.0))))


def measured_gain(
    segment: Segment | Sequence[Segment],
    follower: int,
    level: float = LEVEL,
    reference: Parameters | None = None,
) -> MeasuredGain:
    """The gain |V_i / V_{i-1}| of one follower by Welch's method.

    Where samples are missing for longer than a straight line may bridge, or are excluded, the
    complete stretches between them are averaged, as are those of several windows.

    Args:
        segment: a window, or several.
        follower: 0 for the first.
        level: how often the band is to cover the gain, between 0 and 1.
        reference: (1,) a model of the follower, beside which its gain is measured; see above.

    Raises:
        SegmentError: where the complete stretches are too short for an average.
        ParameterError: where the reference is not one car.

    Examples:
        >>> import accpinn
        >>> segment = accpinn.cut(accpinn.sample("motorway"), 0, 300, (1, 2))
        >>> gain = accpinn.measured_gain(segment, follower=0)
        >>> gain.omega.shape == gain.gain.shape
        True
    """
    segments = (segment,) if isinstance(segment, Segment) else tuple(segment)
    if not segments:
        raise SegmentError("segment: none is given; choose one, or several in a list.")
    if not all(0 <= follower < part.followers for part in segments):
        raise SegmentError(
            f"follower: {follower} is not there; choose 0 to {segments[0].followers - 1}, the first"
            " is 0."
        )
    check_level(level)
    if reference is not None:
        reference = Parameters.of(reference.complete.reshape(-1, 6))
        if len(reference) != 1:
            raise ParameterError(
                f"reference: {len(reference)} cars are given; choose the parameters of the follower"
                " alone."
            )
    return _measured(segments, follower, follower + 1, level, reference)


def head_to_tail_gain(
    segments: Sequence[Segment], level: float = LEVEL, reference: Parameters | None = None
) -> MeasuredGain:
    """The gain |V_M / V_0| of a whole platoon; the reference (M,) is a model of its followers.

    Raises:
        SegmentError: where the complete stretches are too short for an average.
    """
    return _measured(tuple(segments), 0, segments[0].followers, level, reference)


def _measured(
    segments: Sequence[Segment],
    first: int,
    last: int,
    level: float,
    reference: Parameters | None,
) -> MeasuredGain:
    """The gain from the speed in one column to that in another."""
    label, step = segments[0].labels[last], segments[0].sample_time
    usable = [
        (part.time[stretch.rows], part.speeds[stretch.rows][:, [first, last]])
        for part in segments
        for stretch in stretches(_complete(part, first, last))
    ]
    # A stretch of N speeds has N - 1 differences, a piece an even number of them.
    lengths = [len(pair) - 1 for _, pair in usable]
    wanted = min(SHARE * sum(lengths), LONGEST / step, max(lengths, default=0))
    length = 2 * round(max(wanted, SHORTEST / step) / 2.0 - 0.25)
    usable = [(time, pair) for time, pair in usable if len(pair) > length]
    counts = [2 * (len(pair) - 1) // length - 1 for _, pair in usable]
    if sum(counts) < LEAST_PIECES:
        raise SegmentError(
            f"{label}: no measured gain, as the complete stretches of the"
            f" window hold fewer than {LEAST_PIECES} pieces of {SHORTEST:g} s; choose a longer"
            " window."
        )
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(length, step), np.float64)
    inside = (omega > 0) & (omega <= FASTEST)

    def answer_to(
        pairs: Sequence[FloatArray],
    ) -> tuple[NDArray[np.complex128], FloatArray, float]:
        """The response, the coherence, and the share of the follower's motion that is coherent."""
        parts = [k * _densities(pair, length) for k, pair in zip(counts, pairs, strict=True)]
        ahead, behind, cross = np.sum(parts, axis=0)[:, inside]
        moving = (ahead.real > 0) & (behind.real > 0)
        answer = cross / np.where(moving, ahead.real, np.inf)
        coherence = np.abs(cross * answer) / np.where(moving, behind.real, np.inf)
        coherence = np.minimum(coherence, 1.0)
        power = np.where(moving, behind.real, 0.0)
        return answer, coherence, float(coherence @ power / max(power.sum(), 1e-300))

    answer, coherence, share = answer_to([pair for _, pair in usable])
    if reference is not None and is_reference(reference):
        passed = [
            np.column_stack([_answer(reference, time, pair[:, 0]), pair[:, 1]])
            for time, pair in usable
        ]
        ratio, sharper, explained = answer_to(passed)
        if explained > share:
            answer = ratio * response(reference, omega[inside]).prod(axis=0)
            coherence = sharper
    gain, averages = np.abs(answer), sum(_independent(count, length) for count in counts)
    with np.errstate(divide="ignore", over="ignore"):  # without coherence the band has no end
        freedom = 2.0 * (averages - 1.0)
        error = np.sqrt((1.0 - coherence) / coherence / freedom)
        factor = np.exp(stdtrit(freedom, 0.5 + level / 2.0) * error)
    return MeasuredGain(
        omega=frozen(omega[inside]),
        response=_locked(answer),
        gain=frozen(gain),
        lower=frozen(gain / factor),
        upper=frozen(np.where(gain > 0, gain, 1.0) * factor),
        coherence=frozen(coherence),
        coherent=coherence > 1.0 - CHANCE ** (1.0 / (averages - 1.0)),
        level=level,
        averages=averages,
        pieces=sum(counts),
        length=length * step,
    )


def _locked(values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    values.setflags(write=False)
    return values


def is_reference(model: Parameters) -> bool:
    """Whether a gain can be measured beside a model: each car reacts, and its motion ends."""
    try:
        cars = checked(model)
    except ParameterError:
        return False
    is_still = (cars.alpha == 0) & (cars.beta == 0)
    return not is_still.any() and bool(np.isfinite(peaks(cars).gain).all())


def _answer(model: Parameters, time: FloatArray, ahead: FloatArray) -> FloatArray:
    """(N,) the speed of the last of some cars behind a speed (N,), from equilibrium on."""
    start = np.full(len(model), ahead[0])
    gaps = model.complete[:, 3] + np.nan_to_num(model.tau) * ahead[0]
    return np.asarray(simulate(model, time, ahead, start, gaps).speeds[:, -1])


def _complete(segment: Segment, first: int, last: int) -> Mask:
    """(N,) True where both speeds can be used, bridged ones included."""
    complete = np.ones(segment.samples, bool)
    if segment.missing is not None:
        longest = BRIDGE / segment.sample_time
        for gone in stretches(segment.missing[:, [first, last]].any(axis=1)):
            complete[gone.rows] = len(gone) <= longest + 0.5
    return complete if segment.mask is None else complete & segment.mask[:, first:last].all(axis=1)


def _densities(pair: FloatArray, length: int) -> NDArray[np.complex128]:
    """(3, F) spectra of the speed ahead and of the vehicle's, and across them, up to a factor.

    They are means over pieces; scipy's `csd` has the same, but takes half a second to import.
    """
    window, changes = _taper(length), np.diff(pair, axis=0).T
    every = np.lib.stride_tricks.sliding_window_view(changes, length, axis=1)[:, :: length // 2]
    pieces = (every - every.mean(axis=2, keepdims=True)) * window
    ahead, behind = np.fft.rfft(pieces, axis=2)
    pairs = ((ahead, ahead), (behind, behind), (ahead, behind))
    return np.array([(left.conj() * right).mean(axis=0) for left, right in pairs])


def _taper(length: int) -> FloatArray:
    """(length,) the cosine taper of a piece."""
    return np.asarray(np.sin(np.pi / (length + 1) * (np.arange(length) + 0.5)))


def _independent(count: int, length: int) -> float:
    """The number of independent pieces that ``count`` overlapping ones are worth."""
    window, half = _taper(length), length // 2
    shared = float(window[:half] @ window[half:] / (window @ window)) ** 2
    return count / (1.0 + 2.0 * (1.0 - 1.0 / count) * shared)
