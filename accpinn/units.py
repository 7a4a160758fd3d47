"""Units in the signatures: SI everywhere in the package, converted once when a file is read."""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

Seconds = Annotated[float, "s"]
Metres = Annotated[float, "m"]
MetresPerSecond = Annotated[float, "m/s"]
PerSecond = Annotated[float, "1/s"]
RadiansPerSecond = Annotated[float, "rad/s"]

FloatArray = NDArray[np.float64]


def frozen(values: object, *, dtype: type = np.float64) -> FloatArray:
    """A read-only copy of ``values``, for objects that must not change."""
    array: FloatArray = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array
