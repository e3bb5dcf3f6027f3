"""``python -m tools.soak``: see `tools.soak`."""

from tools.soak import main

raise SystemExit(main())
