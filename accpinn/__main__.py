"""`python -m accpinn`: the command line."""

from accpinn.cli import main

raise SystemExit(main())
