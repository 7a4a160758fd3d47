"""Studies: several methods on one segment, several windows, batches over many recordings."""
