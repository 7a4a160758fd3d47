"""Registries of models and methods, to which a test may add."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from accpinn.methods.registry import METHODS, VARIANTS
from accpinn.model.registry import FOLLOWING, TITLES


@contextmanager
def restored() -> Iterator[None]:
    """Forget at the end what was registered meanwhile."""
    registries: tuple[dict[str, Any], ...] = (METHODS, VARIANTS, FOLLOWING, TITLES)
    before = [dict(registry) for registry in registries]
    try:
        yield
    finally:
        for registry, entries in zip(registries, before, strict=True):
            registry.clear()
            registry.update(entries)
