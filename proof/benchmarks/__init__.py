"""Studies behind the pages of ``docs/``: ``python -m`` with their names, in ``proof/``.

Studies import one another, and the small simulators of ``tests/lib``, by their plain names.
"""

import sys
from pathlib import Path

_HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(_HERE), str(_HERE.parents[1] / "tests" / "lib")]
