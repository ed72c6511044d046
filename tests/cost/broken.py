"""As hyperbola.py, with a point that fails."""

from dataclasses import replace

from tests.cost.hyperbola import PANEL as WHOLE
from tests.cost.hyperbola import failing

PANEL = replace(WHOLE, title="Broken", measurements=failing)
