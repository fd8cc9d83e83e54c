"""Every table and figure of the sources, recomputed: `python -m reproductions list`.

One subpackage for each source, one module for each of its tables, figures or worked examples. A module holds
`REPRODUCTIONS`, a tuple of `Reproduction`; the command finds it there. What came of it is written to
`docs/results/reproductions.json` and, from that alone, to `docs/results/reproductions.md`.
"""

from reproductions.record import FULL, QUICK, Effort, Finding, Reproduction, Table, Verdict
from thruster_envs.extras import require

require("baselines", "reproductions")
require("agents", "reproductions")

__all__ = ["FULL", "QUICK", "Effort", "Finding", "Reproduction", "Table", "Verdict"]
