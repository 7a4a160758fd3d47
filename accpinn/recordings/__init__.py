"""OpenACC recordings: a CSV file of the JRC database becomes a `Recording`, or one clear sentence.

Five metadata rows, a row of column names, then one row every 0.1 s, all in SI units. Columns are
chosen by name, as their set and order vary between campaigns: Time, Speed<i>, IVS<i> (space-gap
between vehicles i and i+1), Driver<i>. Positions are not read.

Data format: Makridis et al., Transportation Research Part C 125, 2021, 103047.
"""
