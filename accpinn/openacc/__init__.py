"""OpenACC recordings: a CSV file of the JRC database becomes a `Recording`, or one clear sentence.

Five metadata rows, a row of column names, then one row every 0.1 s, all in SI units. Columns are
chosen by name, as their set and order vary between campaigns: Time, Speed<i>, IVS<i> (space-gap
between vehicles i and i+1), Driver<i>. Positions are not read.

Data format: Makridis et al., Transportation Research Part C 125, 2021, 103047.
"""

from accpinn.openacc.intake import LIMIT_BYTES
from accpinn.openacc.reader import read
from accpinn.openacc.recording import Mode, Recording, Vehicle

__all__ = ["LIMIT_BYTES", "Mode", "Recording", "Vehicle", "read"]
