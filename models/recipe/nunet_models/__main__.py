"""Runs `python -m nunet_models`."""

import sys

from nunet_models.cli import main

sys.exit(main())
