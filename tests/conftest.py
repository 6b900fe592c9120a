"""What tests read of the command line is plain text, whatever the shell asks of terminals."""

import os

for name in ("FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
    os.environ.pop(name, None)
