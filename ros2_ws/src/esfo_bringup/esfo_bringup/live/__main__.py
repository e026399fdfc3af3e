"""Entry point of a live session, `python -m esfo_bringup.live`; an interrupt during loading leaves no traceback."""

import sys

try:
    from esfo_bringup.live.node import main
except KeyboardInterrupt:
    sys.exit(130)

sys.exit(main())
