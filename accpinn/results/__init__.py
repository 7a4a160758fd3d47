"""What leaves the core: messages, tables, figures, snapshots and the report."""
