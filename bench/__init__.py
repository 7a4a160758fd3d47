"""Speed of the methods, and coverage of the intervals, measured."""
