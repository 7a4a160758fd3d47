"""`python -m accpinn`: the command line."""

INTERRUPTED = 130

try:
    from accpinn.cli import main

    status = main()
except KeyboardInterrupt:  # while modules are still being imported
    status = INTERRUPTED
raise SystemExit(status)
