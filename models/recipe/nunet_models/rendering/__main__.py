"""`python -m nunet_models.rendering`: `render` without torch."""

import sys

from nunet_models.rendering.command import main

sys.exit(main())
