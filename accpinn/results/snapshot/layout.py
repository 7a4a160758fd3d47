"""A snapshot as documents and arrays, and back."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from accpinn.errors import SnapshotError
from accpinn.evaluation.evaluation import Evaluation
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.fit import Fit, History, ParameterTrack
from accpinn.model.cthp import Trajectories
from accpinn.results.snapshot.arrays import Arrays, Shape, Sizes, check, check_finite
from accpinn.results.snapshot.codec import Decoder, encode
from accpinn.results.snapshot.content import Origin, Snapshot
from accpinn.results.snapshot.schema import (
    COURSE,
    DATA,
    DRAWS,
    FIELDS,
    HISTORY,
    PARTS,
    SURROGATE,
    Documents,
)
from accpinn.results.snapshot.validate import check_outline, check_plausible
from accpinn.segment.quality import Quality
from accpinn.segment.segment import Segment, SegmentInfo
from accpinn.stability.report import StabilityReport
from accpinn.study.comparison import MethodResult
from accpinn.units import FloatArray

FIT_ELSEWHERE = frozenset({"surrogate", "history", "track", "arrays", "cached"})
DRAWS_ELSEWHERE = frozenset({"draws"})
ABOUT = ("name", "note", "created")


@dataclass(frozen=True)
class Parts:
    """What the file holds: JSON documents and groups of arrays, each by the name of its entry."""

    documents: Documents
    arrays: dict[str, Arrays]


def parts(snapshot: Snapshot) -> Parts:
    """The documents and arrays of a snapshot."""
    draws = _Draws()
    about = {name: getattr(snapshot, name) for name in (*ABOUT, "origin", "info", "facts")}
    documents: Documents = {
        "snapshot.json": encode(about),
        "quality.json": encode(snapshot.quality),
        "fit.json": encode(snapshot.fit, FIT_ELSEWHERE),
        "rows.json": [
            {
                "fit": encode(row.fit, FIT_ELSEWHERE),
                "uncertainty": draws.put(row.uncertainty),
                "evaluation": encode(row.evaluation),
            }
            for row in snapshot.rows
        ],
    }
    if snapshot.uncertainty:
        documents["uncertainty.json"] = draws.put(snapshot.uncertainty)
    if snapshot.evaluation:
        documents["evaluation.json"] = encode(snapshot.evaluation)
    if snapshot.stability:
        documents["stability.json"] = encode(snapshot.stability)
    groups: dict[str, Arrays] = {
        "fit.npz": _curves(snapshot.fit),
        "weights.npz": dict(snapshot.fit.arrays),
        "draws.npz": draws.arrays,
        "rows.npz": _prefixed(
            {str(k): _fields(row.fit.track) for k, row in enumerate(snapshot.rows)}
        ),
    }
    if snapshot.segment:
        groups["data.npz"] = {
            name: values for name in DATA if (values := getattr(snapshot.segment, name)) is not None
        }
    return Parts(documents, groups)


def assemble(stored: Parts, digest: str) -> Snapshot:
    """The snapshot of documents and arrays, after checking all that is in them.

    Raises:
        SnapshotError: naming the part and the place in it.
    """
    return _Assembly(stored).snapshot(digest)


class _Draws:
    """Sets of draws, each kept once: all methods of one case share theirs."""

    def __init__(self) -> None:
        self.arrays: Arrays = {}

    def put(self, uncertainty: Uncertainty) -> dict[str, Any]:
        """An uncertainty as a tree that names its draws."""
        same = [
            k
            for k, a in self.arrays.items()
            if np.array_equal(a, uncertainty.draws, equal_nan=True)
        ]
        name = same[0] if same else str(len(self.arrays))
        self.arrays[name] = uncertainty.draws
        return {"draws": name, "figures": encode(uncertainty, DRAWS_ELSEWHERE)}


def _curves(fit: Fit) -> Arrays:
    groups = {"surrogate": fit.surrogate, "history": fit.history, "track": fit.track}
    return _prefixed({name: _fields(value) for name, value in groups.items()})


def _fields(value: Trajectories | History | ParameterTrack | None) -> Arrays:
    if value is None:
        return {}
    named = {field.name: getattr(value, field.name) for field in fields(value)}
    return {name: values for name, values in named.items() if values is not None}


def _prefixed(groups: Mapping[str, Arrays]) -> Arrays:
    return {
        f"{group}.{name}": values
        for group, arrays in groups.items()
        for name, values in arrays.items()
    }


def _group(arrays: Arrays, prefix: str) -> Arrays:
    """Those arrays whose names begin with the prefix, without it."""
    start = f"{prefix}."
    return {name.removeprefix(start): v for name, v in arrays.items() if name.startswith(start)}


class _Assembly:
    """One reading: what is known of sizes grows from document to document."""

    def __init__(self, stored: Parts) -> None:
        self.documents, self.arrays = stored.documents, stored.arrays
        self.sizes = Sizes()

    def snapshot(self, digest: str) -> Snapshot:
        """All of it."""
        about = self._about()
        info = about["info"]
        self.draws = self._draws()
        fit = self._fit()
        found = Snapshot(
            **about,
            quality=self._decoder("quality.json").read(Quality, self.documents["quality.json"]),
            fit=fit,
            uncertainty=self._uncertainty(),
            evaluation=self._optional("evaluation.json", Evaluation),
            stability=self._optional("stability.json", StabilityReport),
            rows=self._rows(),
            segment=self._segment(info),
            digest=digest,
        )
        check_plausible(found)
        return found

    def _about(self) -> dict[str, Any]:
        tree = self.documents["snapshot.json"]
        decoder = self._decoder("snapshot.json")
        head = decoder.read(_About, tree)
        count = len(head.info.vehicles)
        if count < 2 or head.info.samples < 2:
            raise SnapshotError("The snapshot is refused: its window has no followers or no data.")
        check_outline(head.info)
        self.counts = {"M": count - 1, "V": count, "N": head.info.samples}
        self.sizes = Sizes(**self.counts)
        decoder = self._decoder("snapshot.json")
        decoder.read(SegmentInfo, tree["info"], "info")
        return {field.name: getattr(head, field.name) for field in fields(head)}

    def _fit(self) -> Fit:
        curves, what = self.arrays["fit.npz"], PARTS["fit.npz"].title
        known = {"surrogate": SURROGATE, "history": HISTORY, "track": COURSE}
        groups = {name: _group(curves, name) for name in known}
        if sum(map(len, groups.values())) != len(curves):
            raise SnapshotError(f"The snapshot is refused: {what} hold more than curves.")
        for name, shapes in known.items():
            self._check(groups[name], shapes, f"{what}, {name}")
        weights = self.arrays["weights.npz"]
        for name, values in weights.items():
            check_finite(values, f'{PARTS["weights.npz"].title}, "{name}"')
        return self._decoder("fit.json").read(
            Fit,
            self.documents["fit.json"],
            surrogate=Trajectories(**groups["surrogate"]) if groups["surrogate"] else None,
            history=History(**groups["history"]) if groups["history"] else None,
            track=ParameterTrack(**groups["track"]) if groups["track"] else None,
            arrays=weights,
            cached=False,
        )

    def _check(
        self, arrays: Arrays, shapes: Mapping[str, Shape], what: str, sizes: Sizes | None = None
    ) -> None:
        """Nothing at all, or all of the arrays but those that may be absent."""
        if arrays:
            wanted = {
                name: shape
                for name, shape in shapes.items()
                if name in arrays or name not in ("deviation", "mask")
            }
            check(arrays, wanted, sizes or self.sizes, what)

    def _draws(self) -> dict[str, FloatArray]:
        arrays = self.arrays["draws.npz"]
        shapes = {name: DRAWS for name in arrays}
        check(arrays, shapes, self.sizes, PARTS["draws.npz"].title)
        return {name: np.asarray(values, float) for name, values in arrays.items()}

    def _uncertainty(self) -> Uncertainty | None:
        tree = self.documents.get("uncertainty.json")
        return None if tree is None else self._doubt(tree, self._decoder("uncertainty.json"))

    def _doubt(self, tree: Any, decoder: Decoder) -> Uncertainty:
        named = decoder.read(_Doubt, tree)
        if named.draws not in self.draws:
            raise SnapshotError(f"The snapshot is refused: {decoder.what} lack their draws.")
        return decoder.read(Uncertainty, named.figures, "figures", draws=self.draws[named.draws])

    def _optional(self, name: str, kind: type[Any]) -> Any:
        tree = self.documents.get(name)
        return None if tree is None else self._decoder(name).read(kind, tree)

    def _rows(self) -> tuple[MethodResult, ...]:
        decoder = self._decoder("rows.json")
        trees = decoder.items(_Row, self.documents["rows.json"])
        return tuple(self._row(decoder.read(_Row, tree), k) for k, tree in enumerate(trees))

    def _row(self, tree: "_Row", number: int) -> MethodResult:
        decoder = self._decoder("rows.json")
        track = _group(self.arrays["rows.npz"], str(number))
        self._check(track, COURSE, f"{PARTS['rows.npz'].title}, {number}", Sizes(**self.counts))
        fit = decoder.read(
            Fit,
            tree.fit,
            f"{number}.fit",
            surrogate=None,
            history=None,
            track=ParameterTrack(**track) if track else None,
            arrays={},
            cached=False,
        )
        return MethodResult(
            fit,
            self._doubt(tree.uncertainty, decoder),
            decoder.read(Evaluation, tree.evaluation, f"{number}.assessment"),
        )

    def _segment(self, info: SegmentInfo) -> Segment | None:
        arrays = self.arrays.get("data.npz")
        if arrays is None:
            return None
        what = PARTS["data.npz"].title
        if not arrays:
            raise SnapshotError(f"The snapshot is refused: {what} is empty.")
        self._check(arrays, DATA, what)
        segment = Segment(
            **arrays,
            vehicles=info.vehicles,
            names=info.names,
            start=info.window.start,
            source=info.source,
            sha256=info.sha256,
            findings=info.findings,
            excluded_regimes=info.excluded_regimes,
        )
        if segment.info.digest != info.digest:
            raise SnapshotError(
                f"The snapshot is refused: {what} is not the window that the result was learned"
                " from."
            )
        return segment

    def _decoder(self, name: str) -> Decoder:
        return Decoder(PARTS[name].title, self.sizes, FIELDS)


@dataclass(frozen=True)
class _About:
    """The fields of snapshot.json."""

    name: str
    note: str
    created: str
    origin: Origin
    info: SegmentInfo
    facts: dict[str, Any]


@dataclass(frozen=True)
class _Doubt:
    """An uncertainty whose draws stand elsewhere."""

    draws: str
    figures: Any


@dataclass(frozen=True)
class _Row:
    """A row whose parts are still trees."""

    fit: Any
    uncertainty: Any
    evaluation: Any
