"""What the data say about the parameters: intervals, identifiability, and model adequacy."""
